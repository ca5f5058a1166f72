"""Nodes that are started twice are told of, and each scan counts once all the same."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live_nodes import Observer, StartNode, replay, wait_until
from sensor_msgs.msg import NavSatFix, PointCloud2
from std_srvs.srv import Trigger

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.mapping.store import MapStore
from offradar_ros.nodes.map_server_node import MapServerNode
from offradar_ros.nodes.query_node import QueryNode
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message, model_message
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding

SECOND = 10**9
MODEL = ModelInfo('ring_key', 'ab' * 32, 8, {})
STAMPS = [10 * SECOND + index * SECOND // 4 for index in range(12)]


def embedding(stamp_ns: int, dimension: int = 8) -> PointCloud2:
    mean = np.random.default_rng(stamp_ns).normal(size=dimension).astype(np.float32)
    found = Embedding(stamp_ns, mean, np.ones(dimension, np.float32), MODEL.fingerprint)
    return embedding_message(found, 'radar')


def has_grown(items: list[Any], before: int) -> bool:
    return len(items) == before + 1


def test_with_two_encoders_each_scan_is_mapped_and_answered_once(
    observer: Observer, stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    reports: list[DiagnosticArray] = observer.collect(DiagnosticArray, '/diagnostics')
    bag = street_bag('drive', count=8)
    with stack({'map.path': str(tmp_path / 'map.db')}) as nodes:
        nodes.nodes['second'] = nodes.start('encoder_node', nodes._arguments['encoder_node'], 'second')
        nodes.wait_until_ready()
        wait_until(lambda: observer.node.count_publishers('embedding') == 2)
        first = replay(nodes, bag, '--lockstep', '--session')
        again = replay(nodes, bag, '--lockstep', '--loop', '2')
        wait_until(
            lambda: any(
                'another /encoder publishes /embedding, /embedding/model too: launched twice?' in each.message
                for message in list(reports)
                for each in message.status
                if each.level == DiagnosticStatus.WARN
            )
        )
    for printed in (first, again):
        assert '0 unanswered, 0 answered twice' in printed
    (session,) = MapStore.open_read_only(tmp_path / 'map.db').sessions
    assert sum(session.report[name] for name in ('inserted', 'replaced', 'kept')) == 8


def test_the_query_node_answers_a_scan_once_until_a_recording_starts(observer: Observer, start_node: StartNode) -> None:
    node = start_node(QueryNode)
    outcomes = observer.collect_outcomes()
    observer.wait_until_connected()
    send = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    for stamp in STAMPS[:3] * 2:
        send(embedding(stamp))
    wait_until(lambda: node.status.drops['repeated_scan'] == 3)
    assert len(outcomes) == 3
    # It is shorter than a jump back that would show it.
    assert observer.call(Trigger, 'query/start_recording', Trigger.Request()).success
    for stamp in STAMPS[:3]:
        send(embedding(stamp))
    wait_until(lambda: len(outcomes) == 6)
    assert node.status.drops == {'repeated_scan': 3}


def test_a_recording_that_jumps_back_is_answered_again(observer: Observer, start_node: StartNode) -> None:
    node = start_node(QueryNode)
    outcomes = observer.collect_outcomes()
    observer.wait_until_connected()
    send = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    for _ in range(2):
        for stamp in STAMPS:
            before = len(outcomes)
            send(embedding(stamp))
            # No more of them at once than a queue takes.
            wait_until(partial(has_grown, outcomes, before))
    assert node.status.drops == {}


def test_the_map_server_maps_a_scan_once_also_where_one_encoder_refused_it(
    observer: Observer, start_node: StartNode
) -> None:
    node = start_node(MapServerNode, {'map.match_distance_m': 0.01, 'map.autosave_s': 0.0})
    observer.publisher(DiagnosticStatus, 'embedding/model', qos.LATCHED)(model_message(MODEL))
    send = observer.publisher(PointCloud2, 'embedding', qos.RESULTS)
    fix = observer.publisher(NavSatFix, 'gps/fix', qos.POSITIONS)
    wait_until(lambda: node.stage.map.model)
    for index, stamp in enumerate(STAMPS):
        fix(NavSatFix(header=header(stamp, 'gps'), latitude=51.75 + 1e-4 * index, longitude=-1.25))
    for stamp in STAMPS[:3]:
        for dimension in (0, 8, 8):
            send(embedding(stamp, dimension))
    wait_until(lambda: node.status.drops == {'invalid_embedding': 3, 'repeated_scan': 3})
    wait_until(lambda: len(node.stage.map) == 3)
    report = observer.call(Trigger, 'map_server/end_session', Trigger.Request()).message
    assert '3 inserted, 0 replaced, 0 kept' in report
