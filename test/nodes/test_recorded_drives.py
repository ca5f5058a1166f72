"""Recorded drives through the three nodes, each in its own process, over DDS."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import rclpy.serialization
from live_nodes import Observer, replay, wait_until
from sensor_msgs.msg import Image, PointCloud2

from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.mapping.store import MapStore
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.datasets.registry import open_sequence
from offradar_ros.ros import qos


def counts(printed: str) -> dict[str, int]:
    line = next(line for line in printed.splitlines() if line.startswith('replayed'))
    counted = re.sub(r' \([^)]*\)', '', line.removeprefix('replayed ').partition(' in ')[0])
    return {name: int(count) for count, name in (part.split(' ', 1) for part in counted.split(', '))}


RING_KEY: dict[str, str] = {}
COMPACT = {'encoder.name': 'variational', 'encoder.weights': 'compact'}


@pytest.mark.parametrize(
    ('name', 'scans', 'mapped', 'encoder'),
    [
        ('oxford_tiny', 11, True, RING_KEY),
        ('oxford_tiny', 11, True, COMPACT),
        ('radiate_tiny_foggy', 18, False, RING_KEY),
    ],
)
def test_every_scan_is_embedded_and_answered_once(
    real_data: Path,
    tmp_path: Path,
    stack: Callable[..., Stack],
    name: str,
    scans: int,
    mapped: bool,
    encoder: dict[str, str],
) -> None:
    if encoder:
        pytest.importorskip('onnxruntime')
    bag = write_bag(open_sequence(real_data / name), tmp_path / name)
    with stack(
        {'map.path': str(tmp_path / 'map.db'), 'query.delta': 100.0, 'query.min_probability': 0.0, **encoder}
    ) as nodes:
        nodes.wait_until_ready()
        first = counts(replay(nodes, bag, '--lockstep', '--session'))
        second = counts(replay(nodes, bag, '--lockstep'))
    answered = {'scans': scans, 'embeddings': scans, 'unanswered': 0, 'answered twice': 0}
    assert first == answered | {'matches': 0, 'rejections': scans}
    # RADIATE's positions start a minute after its scans: nothing is mapped, and the query reports that.
    assert second == answered | {'matches': scans * mapped, 'rejections': scans * (not mapped)}
    assert (len(MapStore.open_read_only(tmp_path / 'map.db').places) > 0) == mapped


def test_the_message_of_a_live_driver_is_accepted_as_it_is(
    real_data: Path, observer: Observer, stack: Callable[..., Stack]
) -> None:
    cdr = (real_data / 'navtech_ros2' / 'b_scan_image.cdr').read_bytes()
    image = rclpy.serialization.deserialize_message(cdr, Image)
    embeddings = observer.collect(PointCloud2, 'embedding')
    outcomes = observer.collect_outcomes()
    with stack() as nodes:
        nodes.wait_until_ready()
        # The map server, the query node and this one.
        observer.wait_until_connected(embedding=3)
        send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
        send(cdr)
        wait_until(lambda: embeddings and outcomes)
    (embedding,) = embeddings
    assert embedding.header == image.header
    assert embedding.width == 128
    assert outcomes[0].reason == 'map_empty'  # type: ignore[union-attr]
