"""A replay of bags with several topics, compressed scans, and what other packages said when they were recorded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_nodes import ROOMY, WAIT_S, Observer, replay, wait_until
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import serialize_message
from recorded_topics import Recorded, compressed_scans, fixes, grid, images, record, report, scans
from sensor_msgs.msg import CompressedImage, Image, NavSatFix
from std_msgs.msg import String

from offradar_ros.lab.live.node_processes import Stack
from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.recordings.bags.topics import FIX_TYPE, IMAGE_TYPE
from offradar_ros.ros import qos
from offradar_ros.ros.recorded_outputs import STATUS_NAME


@pytest.fixture
def alone(stack: Callable[..., Stack]) -> Callable[..., Stack]:
    """No nodes: the observer is the only subscriber."""
    return lambda: stack(names=())


def refused(nodes: Stack, *arguments: str) -> str:
    process = nodes.start('replay_node', arguments, 'refused')
    try:
        assert process.wait(2 * WAIT_S) == 1
        printed = process.log.read_text()
    finally:
        process.stop()
    assert 'Traceback' not in printed
    (line,) = [line for line in printed.splitlines() if line.startswith('error: ')]
    return line


def test_compressed_scans_are_encoded_as_the_images(
    stack: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    drive = street(count=6)
    bag = record(tmp_path / 'bag', compressed_scans(drive), fixes(drive))
    with stack(ROOMY | {'radar.transport': 'compressed', 'map.path': str(tmp_path / 'map.db')}) as nodes:
        nodes.wait_until_ready()
        assert '6 embeddings, 0 matches, 6 rejections (6 map_empty)' in replay(nodes, bag, '--lockstep', '--session')
        assert '6 scans, 6 embeddings' in replay(nodes, bag, '--lockstep')


def test_a_compressed_image_that_is_no_scan_does_not_end_the_encoder(
    observer: Observer, start_node: Callable[..., Any], street: Callable[..., Any]
) -> None:
    encoder = start_node(EncoderNode, {'radar.transport': 'compressed'})
    publish = observer.publisher(CompressedImage, 'radar_data/b_scan_image/compressed', qos.SCANS)
    for number, data in enumerate((b'\xff\xd8\xff\xe0 a JPEG', b'', b'\x89PNG\r\n\x1a\n')):
        message = CompressedImage(format='png', data=data)
        message.header.stamp.sec = number + 1
        publish(message)
        wait_until(lambda seen=number + 1: encoder.status.drops.total() == seen)  # type: ignore[misc]
    assert encoder.status.drops == {'lossy_image': 1, 'wrong_encoding': 2}


def test_without_the_parameter_the_replay_says_what_reads_compressed_scans(
    stack: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    bag = record(tmp_path / 'bag', compressed_scans(street(count=2)))
    with stack() as nodes:
        nodes.wait_until_ready()
        line = refused(nodes, str(bag), '--timeout', '2')
    assert 'no subscriber within 2 s: start the encoder node with radar.transport: compressed' in line


def test_the_chosen_topics_are_played_on_the_inputs_of_the_nodes(
    observer: Observer, alone: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    near, far = street(count=3), street(count=3, start_ns=1_600_000_000_010_000_000)
    bag = record(
        tmp_path / 'bag',
        scans(near),
        scans(far, '/car2/scan'),
        fixes(near),
        fixes(far, '/car2/fix', 0.5),
        images(near, '/camera/image', 'mono8', 48, 64),
    )
    heard = observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS)
    positions = observer.collect(NavSatFix, 'gps/fix')
    camera = observer.collect(Image, 'camera/image', qos.SCANS)
    with alone() as nodes:
        printed = replay(nodes, bag, '--rate', '4', '--topic', '/car2/scan', '--positions', 'car2/fix')
    wait_until(lambda: len(heard) == 3 and len(camera) == 3 and len(positions) == len(far.trajectory))
    assert {image.header.stamp.nanosec % 250_000_000 for image in heard} == {10_000_000}
    assert all(position.longitude > -1.0 for position in positions)
    assert '/radar_data/b_scan_image: not played, /car2/scan is played in its place' in printed
    assert '/gps/fix: not played, /car2/fix is played in its place' in printed


def test_a_topic_that_the_encoder_does_not_read_names_the_option(
    stack: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    drive = street(count=6)
    bag = record(tmp_path / 'bag', scans(drive, '/navtech/scan'), fixes(drive, '/fix'))
    with stack({'map.path': str(tmp_path / 'map.db')}) as nodes:
        nodes.wait_until_ready()
        line = refused(nodes, str(bag), '--timeout', '2')
        assert 'replay with --topic /navtech/scan to play it on radar_data/b_scan_image' in line
        printed = replay(nodes, bag, '--lockstep', '--topic', '/navtech/scan')
        assert 'nobody reads the positions on /fix: --positions NAME' in printed
        printed = replay(nodes, bag, '--lockstep', '--session', '--topic', '/navtech/scan', '--positions', '/fix')
        assert 'nobody reads' not in printed
        assert '0 dropped; places 0 -> ' in printed


def test_bags_without_scans_or_with_a_choice_are_one_line(
    alone: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    drive = street(count=2)
    silent = record(tmp_path / 'silent', fixes(drive), empty=[('/radar_data/b_scan_image', IMAGE_TYPE)])
    nothing = record(tmp_path / 'nothing', empty=[('/gps/fix', FIX_TYPE)])
    choice = record(tmp_path / 'choice', scans(drive, '/a/scan'), scans(drive, '/b/scan'))
    with alone() as nodes:
        for way in (['--rate', '2'], ['--lockstep']):
            assert 'no scans: topic /radar_data/b_scan_image holds no messages' in refused(nodes, str(silent), *way)
        assert 'no scans: expected a topic of' in refused(nodes, str(nothing))
        assert 'choose one with --topic: /a/scan' in refused(nodes, str(choice))
        assert '--topic /c/scan is not in it' in refused(nodes, str(choice), '--topic', '/c/scan')


def test_what_others_said_is_played_and_what_our_nodes_said_is_not(
    observer: Observer, alone: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    drive = street(count=4)
    stamp_ns = int(drive.stamps_ns[1])
    own = f'encoder{STATUS_NAME}'
    text = Recorded(stamp_ns, '/matches', 'std_msgs/msg/String', serialize_message(String(data='3:2')))
    frames = Recorded(stamp_ns, '/tf_static', 'std_msgs/msg/String', serialize_message(String(data='base_link')))
    odd = Recorded(stamp_ns, '/2d-map', 'std_msgs/msg/String', serialize_message(String(data='a name of ROS 1')))
    bag = record(
        tmp_path / 'bag',
        scans(drive),
        [grid(stamp_ns, '/map'), grid(stamp_ns, '/slam/map'), text, frames, odd],
        [report(stamp_ns + index, name) for index, name in enumerate(['navtech: temperature', own, 'gps: fix'])],
        latched_topics=['/map'],
    )
    observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS)
    grids = observer.collect(OccupancyGrid, '/map', qos.LATCHED)
    static = observer.collect(String, '/tf_static', qos.LATCHED)
    slam = observer.collect(OccupancyGrid, '/slam/map')
    reports = observer.collect(DiagnosticArray, '/diagnostics')
    with alone() as nodes:
        printed = replay(nodes, bag, '--rate', '2')
    wait_until(lambda: grids and slam and static and len(reports) >= 2)
    names = [status.name for message in reports for status in message.status]
    assert names == ['navtech: temperature', 'gps: fix']
    # The player itself listens to answers on the first, which are of another type; ROS 2 does not allow the second.
    assert '/matches: cannot be published as std_msgs/msg/String here: not played' in printed
    assert '/2d-map: cannot be published as std_msgs/msg/String here: not played' in printed
    assert 'replayed 4 scans' in printed


def test_nodes_report_under_the_name_that_a_replay_leaves_out(start_node: Callable[..., Any]) -> None:
    (status,) = start_node(EncoderNode).status.message(0).status
    assert status.name.endswith(STATUS_NAME)


def test_a_damaged_message_is_left_out(
    observer: Observer, alone: Callable[..., Stack], street: Callable[..., Any], tmp_path: Path
) -> None:
    rows = list(scans(street(count=4)))
    rows[2] = rows[2]._replace(message=b'\0\1\0\0ab')
    bag = record(tmp_path / 'bag', rows)
    heard = observer.collect(Image, 'radar_data/b_scan_image', qos.SCANS)
    with alone() as nodes:
        printed = replay(nodes, bag, '--rate', '4', '--restamp')
    wait_until(lambda: len(heard) == 3)
    assert 'a message of 6 bytes' in printed
    assert 'replayed 3 scans' in printed
