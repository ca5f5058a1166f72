"""The replay plays what was recorded: bytes, order, rate, clock and stamps."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from live_nodes import WAIT_S, Observer, replay, wait_until
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, NavSatFix

from offradar_ros.bags.reader import Bag
from offradar_ros.bags.records import stamp_ns
from offradar_ros.mapping.store import MapStore
from offradar_ros.ros import qos
from offradar_ros.ros.processes import Stack


@pytest.fixture
def alone(stack: Callable[..., Stack]) -> Callable[..., Stack]:
    """No nodes: the observer is the only one to listen."""
    return lambda: stack(names=())


def test_the_recorded_bytes_are_published(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    bag = street_bag('drive', count=4)
    images = observer.hear(Image, 'radar_data/b_scan_image', qos.SCANS, raw=True)
    fixes = observer.hear(NavSatFix, 'gps/fix', raw=True)
    with alone() as nodes:
        replay(nodes, bag, '--rate', '10')
    with Bag(bag) as opened:
        recorded = {topic: [m.cdr for m in opened.messages([topic])] for topic in opened.topics}
    wait_until(lambda: len(images) == 4 and len(fixes) == len(recorded['/gps/fix']))
    assert images == recorded['/radar_data/b_scan_image']
    # DDS fills the last word of a payload with zeros.
    assert [fix.rstrip(b'\0') for fix in fixes] == [fix.rstrip(b'\0') for fix in recorded['/gps/fix']]


def test_the_clock_is_the_recording(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    bag = street_bag('drive', count=4)
    clocks = observer.hear(Clock, '/clock')
    observer.hear(Image, 'radar_data/b_scan_image', qos.SCANS)
    with alone() as nodes:
        replay(nodes, bag, '--rate', '4')
    with Bag(bag) as opened:
        start_ns, end_ns = opened.start_ns, opened.end_ns
    times = [stamp_ns(message.clock) for message in clocks]
    assert start_ns <= times[0] < times[-1] <= end_ns + 10**8
    assert times[-1] - times[0] > 0.8 * (end_ns - start_ns)
    assert times == sorted(times)


def test_nodes_follow_the_clock_of_the_recording(
    stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag = street_bag('drive', count=8)
    with stack({'map.path': str(tmp_path / 'map.db'), 'use_sim_time': True}) as nodes:
        nodes.wait_until_ready()
        replay(nodes, bag, '--lockstep')
        replay(nodes, bag, '--lockstep', '--session')
    with Bag(bag) as opened:
        start_ns, end_ns = opened.start_ns, opened.end_ns
    (session,) = MapStore.open_read_only(tmp_path / 'map.db').sessions
    assert start_ns <= session.stamp_ns <= end_ns + 10**9


def test_loops_and_new_stamps(observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]) -> None:
    images = observer.hear(Image, 'radar_data/b_scan_image', qos.SCANS)
    before_ns = time.time_ns()
    with alone() as nodes:
        replay(nodes, street_bag('drive', count=3), '--rate', '10', '--loop', '2', '--restamp')
    wait_until(lambda: len(images) == 6)
    stamps = [stamp_ns(image.header.stamp) for image in images]
    assert all(before_ns < stamp < time.time_ns() for stamp in stamps)
    assert stamps == sorted(stamps)


def test_a_namespace_and_a_remapping_move_every_topic(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    images = observer.hear(Image, '/car/radar/polar', qos.SCANS)
    with alone() as nodes:
        renamed = ['--ros-args', '-r', '__ns:=/car', '-r', 'radar_data/b_scan_image:=radar/polar']
        replay(nodes, street_bag('drive', count=2), '--rate', '10', *renamed)
    wait_until(lambda: len(images) == 2)


def failed(nodes: Stack, *arguments: str) -> str:
    process = nodes.start('replay_node', arguments, 'failing')
    try:
        assert process.wait(WAIT_S) not in (0, -11)
        return process.log.read_text()
    finally:
        process.stop()


def test_bad_arguments_and_bad_bags_are_one_line(
    alone: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag = street_bag('drive', count=2)
    (tmp_path / 'foreign').mkdir()
    (tmp_path / 'foreign' / 'recording.mcap').write_bytes(b'not a recording')
    cases: dict[str, tuple[Any, ...]] = {
        'no such bag': (str(tmp_path / 'missing'),),
        'metadata.yaml': (str(tmp_path / 'foreign'),),
        'not a readable rosbag2 recording': (str(tmp_path / 'foreign' / 'recording.mcap'),),
        '--rate: expected above 0': (str(bag), '--rate', '0'),
        'nothing subscribed within': (str(bag), '--timeout', '0.5'),
    }
    with alone() as nodes:
        for said, arguments in cases.items():
            printed = failed(nodes, *arguments)
            assert said in printed
            assert 'Traceback' not in printed


def test_lockstep_says_when_nothing_answers(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    # Something reads the scans and publishes embeddings, in name only.
    observer.hear(Image, 'radar_data/b_scan_image', qos.SCANS)
    observer.node.create_publisher(Image, 'matches', qos.RESULTS)
    with alone() as nodes:
        printed = failed(nodes, str(street_bag('drive', count=8)), '--lockstep', '--timeout', '0.5')
    assert 'error: the nodes answered none of the last 3 scans' in printed


def test_a_stop_in_the_middle_is_clean(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    images = observer.hear(Image, 'radar_data/b_scan_image', qos.SCANS)
    with alone() as nodes:
        process = nodes.start('replay_node', [str(street_bag('drive')), '--loop', '0'])
        wait_until(lambda: images)
        assert process.stop() == 0
        assert 'Traceback' not in process.log.read_text()
