"""The replay plays what was recorded: bytes, order, rate, clock and stamps."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_nodes import ROOMY, WAIT_S, Observer, replay, wait_until
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, NavSatFix, PointCloud2
from std_msgs.msg import Bool

from offradar_ros.geometry import Trajectory
from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.mapping.store import MapStore
from offradar_ros.messages import stamp_ns
from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.writer import image_message, write_bag
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_message
from offradar_ros.types import Embedding


@pytest.fixture
def alone(stack: Callable[..., Stack]) -> Callable[..., Stack]:
    """No nodes: the observer is the only subscriber."""
    return lambda: stack(names=())


def test_the_recorded_bytes_are_published(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    bag = street_bag('drive', count=4)
    images = observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS, raw=True)
    fixes = observer.collect(NavSatFix, 'gps/fix', raw=True)
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
    clocks = observer.collect(Clock, '/clock', qos.UPDATES)
    observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS)
    with alone() as nodes:
        replay(nodes, bag, '--rate', '1')
    with Bag(bag) as opened:
        start_ns, end_ns = opened.start_ns, opened.end_ns
    # On a busy machine, a late connection misses the first messages.
    wait_until(lambda: clocks and stamp_ns(clocks[-1].clock) - stamp_ns(clocks[0].clock) > 0.5 * (end_ns - start_ns))
    times = [stamp_ns(message.clock) for message in clocks]
    assert start_ns <= times[0] < times[-1] <= end_ns + 10**8
    assert times == sorted(times)


def test_the_report_holds_what_was_printed(
    stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    report = tmp_path / 'report.json'
    with stack() as nodes:
        nodes.wait_until_ready()
        printed = replay(nodes, street_bag('drive', count=6), '--lockstep', '--loop', '2', '--report', str(report))
    reported = json.loads(report.read_text())
    assert (reported['scans'], reported['embeddings'], reported['rejections'], reported['unanswered']) == (
        12,
        12,
        12,
        0,
    )
    assert reported['reasons'] == {'map_empty': 12}
    assert len(reported['latencies_s']) == 12
    assert '12 rejections (12 map_empty)' in printed


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
    images = observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS)
    before_ns = time.time_ns()
    with alone() as nodes:
        replay(nodes, street_bag('drive', count=2), '--rate', '10', '--loop', '2', '--restamp')
    # No more messages than a publisher keeps for late subscribers.
    wait_until(lambda: len(images) == 4)
    stamps = [stamp_ns(image.header.stamp) for image in images]
    assert all(before_ns < stamp < time.time_ns() for stamp in stamps)
    assert stamps == sorted(stamps)


def test_a_namespace_and_a_remapping_move_every_topic(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    images = observer.collect(Image, '/car/radar/polar', qos.SCANS)
    with alone() as nodes:
        renamed = ['--ros-args', '-r', '__ns:=/car', '-r', 'radar_data/b_scan_image:=radar/polar']
        replay(nodes, street_bag('drive', count=2), '--rate', '10', *renamed)
    wait_until(lambda: len(images) == 2)


def failed(nodes: Stack, *arguments: str) -> str:
    process = nodes.start('replay_node', arguments, 'failing')
    try:
        assert process.wait(2 * WAIT_S) not in (0, -11)
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
        'no subscriber within': (str(bag), '--timeout', '0.5'),
    }
    with alone() as nodes:
        for expected, arguments in cases.items():
            printed = failed(nodes, *arguments)
            assert expected in printed
            assert 'Traceback' not in printed


def test_lockstep_ends_with_an_error_if_nothing_answers(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    # A node subscribes to the scans and has a publisher of matches, but never answers.
    observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS)
    observer.node.create_publisher(Image, 'matches', qos.RESULTS)
    with alone() as nodes:
        printed = failed(nodes, str(street_bag('drive', count=8)), '--lockstep', '--timeout', '10')
    assert 'error: nothing on matches for the last 3 scans' in printed


def test_a_stop_in_the_middle_is_clean(
    observer: Observer, alone: Callable[..., Stack], street_bag: Callable[..., Path]
) -> None:
    images = observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS)
    with alone() as nodes:
        process = nodes.start('replay_node', [str(street_bag('drive')), '--loop', '0'])
        wait_until(lambda: images)
        assert process.stop() == 0
        assert 'Traceback' not in process.log.read_text()


def test_an_interrupted_session_is_ended_and_kept(
    observer: Observer, stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag = street_bag('drive', count=40)
    embeddings = observer.collect(PointCloud2, 'embedding')
    with stack({'map.path': str(tmp_path / 'map.db')}) as nodes:
        nodes.wait_until_ready()
        process = nodes.start('replay_node', [str(bag), '--session', '--rate', '0.5'], 'interrupted')
        wait_until(lambda: embeddings)
        assert process.stop() == 0
        printed = process.log.read_text()
        assert 'interrupted' in printed
        assert 'session 1: ' in printed
        assert 'Traceback' not in printed
        # The next session starts as usual, though its scans jump back by less than a second.
        replay(nodes, bag, '--lockstep', '--session')
    assert [s.state for s in MapStore.open_read_only(tmp_path / 'map.db').sessions] == ['ended', 'ended']


@pytest.fixture
def everything(street: Callable[..., Any], tmp_path: Path) -> Path:
    """A bag of all topics of a vehicle: recorded answers, and messages without a header."""
    sequence, path = street(count=6), tmp_path / 'everything'
    types = TYPES.types
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        scans = writer.add_connection('/radar_data/b_scan_image', 'sensor_msgs/msg/Image', typestore=TYPES)
        flags = writer.add_connection('/door_open', 'std_msgs/msg/Bool', typestore=TYPES)
        embeddings = writer.add_connection('/embedding', 'sensor_msgs/msg/PointCloud2', typestore=TYPES)
        old = embedding_message(Embedding(1, np.ones(8, np.float32), np.ones(8, np.float32), 'ab' * 32), 'radar')
        for index in range(len(sequence)):
            stamp = int(sequence.stamps_ns[index])
            image = image_message(sequence.scan(index), plain=True)
            writer.write(scans, stamp, TYPES.serialize_cdr(image, 'sensor_msgs/msg/Image'))
            writer.write(flags, stamp, TYPES.serialize_cdr(types['std_msgs/msg/Bool'](data=True), 'std_msgs/msg/Bool'))
            old.header.stamp.sec, old.header.stamp.nanosec = divmod(stamp, 10**9)
            writer.write(embeddings, stamp, serialize_message(old))
    return path


def test_recorded_answers_of_nodes_are_not_played(
    observer: Observer, stack: Callable[..., Stack], everything: Path
) -> None:
    doors = observer.collect(Bool, 'door_open')
    with stack(ROOMY) as nodes:
        nodes.wait_until_ready()
        printed = replay(nodes, everything, '--rate', '4', '--restamp')
        assert '6 scans, 6 embeddings, 0 matches, 6 rejections (6 map_empty), 0 unanswered' in printed
        wait_until(lambda: len(doors) == 6)
        printed = replay(nodes, everything, '--lockstep')
        assert '6 scans, 6 embeddings' in printed
        wait_until(lambda: len(doors) == 12)
    assert all(door.data for door in doors)


def test_an_incompatible_subscriber_is_not_awaited(
    observer: Observer, stack: Callable[..., Stack], everything: Path
) -> None:
    """Transient-local subscriptions, which never connect to the volatile publishers of these topics."""
    observer.collect(Bool, 'door_open', qos.LATCHED)
    observer.collect(PointCloud2, 'embedding', qos.LATCHED)
    with stack() as nodes:
        nodes.wait_until_ready()
        printed = replay(nodes, everything, '--lockstep')
    assert '6 scans, 6 embeddings' in printed
    assert 'not all connected' not in printed
    assert 'not every subscriber' not in printed


def test_a_subscriber_that_hangs_is_reported_and_not_waited_for(stack: Callable[..., Stack], everything: Path) -> None:
    code = (
        'import rclpy\n'
        'from std_msgs.msg import Bool\n'
        'rclpy.init()\n'
        'node = rclpy.create_node("listener")\n'
        'node.create_subscription(Bool, "door_open", lambda _: print("received", flush=True), 10)\n'
        'rclpy.spin(node)\n'
    )
    with stack() as nodes:
        nodes.wait_until_ready()
        command = [sys.executable, '-c', code]
        with subprocess.Popen(command, env=nodes.environment, stdout=subprocess.PIPE) as listener:
            try:
                # DDS itself gives a silent process up after 20 s: playing and waiting must take less, also when busy.
                arguments = [str(everything), '--lockstep', '--loop', '30', '--timeout', '8']
                process = nodes.start('replay_node', arguments, 'hanging')
                assert listener.stdout is not None
                assert listener.stdout.readline() == b'received\n'
                listener.send_signal(signal.SIGSTOP)
                assert process.wait(4 * WAIT_S) == 0
            finally:
                listener.kill()
    printed = process.log.read_text()
    assert '180 scans, 180 embeddings' in printed
    assert '/door_open: not acknowledged by every subscriber within 8 s' in printed


@pytest.mark.parametrize('count', [1, 3])
def test_a_recording_that_is_shorter_than_the_restart_gap_is_played_again(
    stack: Callable[..., Stack], street_bag: Callable[..., Path], count: int
) -> None:
    bag = street_bag('drive', count=count)
    with stack({'query.min_probability': 0.0}) as nodes:
        nodes.wait_until_ready()
        for loops in (3, 1):
            scans = loops * count
            printed = replay(nodes, bag, '--lockstep', '--loop', str(loops))
            assert f'replayed {scans} scans, {scans} embeddings, 0 matches, {scans} rejections' in printed
            assert f'({scans} map_empty), 0 unanswered, 0 answered twice' in printed
        printed = replay(nodes, bag, '--lockstep', '--loop', '2', '--session')
        assert ', 0 dropped; places 0 -> 1, ' in printed
        printed = replay(nodes, bag, '--lockstep')
        assert f'replayed {count} scans, {count} embeddings, {count} matches' in printed


def test_a_flood_of_positions_loses_no_scan(
    stack: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    """An INS of 200 positions a second, and a map server that is stopped when they are sent."""
    sequence = street(count=8)
    slow = sequence.trajectory
    stamps = np.arange(slow.stamps_ns[0] - 4 * 10**9, slow.stamps_ns[-1], 5_000_000)
    each = [np.interp(stamps, slow.stamps_ns, column) for column in slow.positions.T]
    flood = Trajectory(stamps, np.stack(each, axis=1), np.full(len(stamps), np.nan), geodetic=True)
    bag = write_bag(sequence.with_trajectory(flood), tmp_path / 'flooded')
    with stack({'map.path': str(tmp_path / 'map.db')}) as nodes:
        nodes.wait_until_ready()
        process = nodes.start('replay_node', [str(bag), '--lockstep', '--session'])
        wait_until(lambda: 'session 1 started' in process.log.read_text())
        server = nodes.nodes['map_server_node'].process
        server.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        server.send_signal(signal.SIGCONT)
        assert process.wait(2 * WAIT_S) == 0
        assert '0 dropped' in process.log.read_text()


@pytest.mark.parametrize('after_s', [0.01, 0.3])
def test_a_second_interrupt_does_not_keep_the_session_from_ending(
    observer: Observer, stack: Callable[..., Stack], street_bag: Callable[..., Path], tmp_path: Path, after_s: float
) -> None:
    embeddings = observer.collect(PointCloud2, 'embedding')
    with stack({'map.path': str(tmp_path / 'map.db')}) as nodes:
        nodes.wait_until_ready()
        arguments = [str(street_bag('drive', count=40)), '--session', '--rate', '0.5']
        process = nodes.start('replay_node', arguments, 'interrupted')
        wait_until(lambda: embeddings)
        process.process.send_signal(signal.SIGINT)
        time.sleep(after_s)
        assert process.stop() == 0
        assert 'session 1: ' in process.log.read_text()
    assert [s.state for s in MapStore.open_read_only(tmp_path / 'map.db').sessions] == ['ended']
