"""What is written to a bag comes back from it, by our reader and by the official one."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray
from recorded_topics import scans
from rosbags.rosbag2 import StoragePlugin, Writer

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import LocalFrame
from offradar_ros.messages import header_stamp_ns, with_header_stamp
from offradar_ros.positions.rules import END_NS
from offradar_ros.recordings.bags.positions import position_topics, read_positions
from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.topics import IMAGE_TYPE, ODOMETRY, SCANS
from offradar_ros.recordings.bags.writer import BagOptions, write_bag
from offradar_ros.recordings.datasets.registry import open_sequence
from offradar_ros.recordings.source import is_bag
from offradar_ros.types import PolarScan


def test_scans_stamps_and_positions_survive(street: Callable[..., Any], tmp_path: Path) -> None:
    sequence = street(count=5)
    bag = BagSequence(write_bag(sequence, tmp_path / 'bag'))
    np.testing.assert_array_equal(bag.stamps_ns, sequence.stamps_ns)
    for index in range(5):
        before, after = sequence.scan(index), bag.scan(index)
        np.testing.assert_array_equal(after.power, before.power)
        np.testing.assert_allclose(after.azimuths_rad, before.azimuths_rad)
        assert (after.stamp_ns, after.range_resolution_m) == (before.stamp_ns, before.range_resolution_m)
    assert bag.trajectory is not None
    inside = np.isin(sequence.trajectory.stamps_ns, bag.trajectory.stamps_ns)
    np.testing.assert_array_equal(bag.trajectory.positions, sequence.trajectory.positions[inside])
    assert bag.trajectory.stamps_ns[0] < bag.stamps_ns[0]
    assert bag.trajectory.stamps_ns[-1] > bag.stamps_ns[-1]


def test_the_official_reader_reads_the_same(street: Callable[..., Any], tmp_path: Path) -> None:
    sequence = street(count=3)
    folder = write_bag(sequence, tmp_path / 'bag')
    (file,) = folder.glob('*.mcap')
    with file.open('rb') as stream:
        messages = list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    times = [record.log_time for _, _, record, _ in messages]
    assert times == sorted(times)
    images = [message for _, channel, _, message in messages if channel.topic == '/radar_data/b_scan_image']
    assert len(images) == 3
    for index, image in enumerate(images):
        assert (image.encoding, image.height, image.step) == ('8UC1', 400, 576)
        np.testing.assert_array_equal(np.frombuffer(image.data, np.uint8).reshape(400, 576), sequence.scan(index).power)
    fixes = [message for _, channel, _, message in messages if channel.topic == '/gps/fix']
    assert all(abs(fix.latitude - 51.75) < 1e-3 and fix.status.status == 0 for fix in fixes)


def test_odometry_is_the_fixes_in_the_local_frame_and_faces_the_way_of_travel(
    street: Callable[..., Any], tmp_path: Path
) -> None:
    with Bag(write_bag(street(), tmp_path / 'bag')) as bag:
        fixes, _ = read_positions(bag, '/gps/fix')
        odometry, _ = read_positions(bag, '/ground_truth/odometry')
    origin = fixes.origin()
    assert origin is not None
    np.testing.assert_allclose(odometry.positions, LocalFrame(origin).to_enu(fixes.positions), atol=1e-9)
    np.testing.assert_allclose(odometry.yaws_rad, 0.0, atol=1e-3)


@pytest.mark.parametrize('kind', ['course', 'measured', 'standing'])
def test_the_covariance_of_odometry_says_how_certain_a_heading_is(
    street: Callable[..., Any], tmp_path: Path, kind: str
) -> None:
    """That of the course is known; 0, which says nothing, for one that a source measured; π² where it is none."""
    sequence = street(count=3)
    track = sequence.trajectory
    if kind == 'measured':
        track = dataclasses.replace(track, yaws_rad=np.linspace(0.0, 0.1, len(track)))
    elif kind == 'standing':
        track = dataclasses.replace(track, positions=np.repeat(track.positions[:1], len(track), axis=0))
    (file,) = write_bag(sequence.with_trajectory(track), tmp_path / 'bag').glob('*.mcap')
    with file.open('rb') as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        variances = [message.pose.covariance[35] for _, channel, _, message in decoded if channel.topic == ODOMETRY]
    assert len(variances) > 5
    if kind == 'course':
        assert 0.0 < min(variances) <= max(variances) < np.radians(10.0) ** 2
    else:
        assert set(variances) == {0.0 if kind == 'measured' else np.pi**2}


def test_metadata_columns_are_kept_unless_plain(real_data: Path, tmp_path: Path) -> None:
    sequence = open_sequence(real_data / 'oxford_tiny')
    recorded = sequence.scan(0)
    kept = BagSequence(write_bag(sequence, tmp_path / 'kept')).scan(0)
    plain = BagSequence(write_bag(sequence, tmp_path / 'plain', BagOptions(plain=True))).scan(0)
    np.testing.assert_array_equal(kept.power, recorded.power)
    np.testing.assert_array_equal(plain.power, recorded.power)
    np.testing.assert_array_equal(kept.azimuths_rad, recorded.azimuths_rad)
    np.testing.assert_array_equal(kept.azimuth_stamps_ns, recorded.azimuth_stamps_ns)
    assert plain.azimuth_stamps_ns is None


def test_position_offset_moves_positions_only(street: Callable[..., Any], tmp_path: Path) -> None:
    sequence = street(count=4)
    late = dataclasses.replace(sequence.trajectory, stamps_ns=sequence.trajectory.stamps_ns + 60 * 10**9)
    apart = sequence.with_trajectory(late)
    with Bag(write_bag(apart, tmp_path / 'apart')) as bag:
        assert not position_topics(bag)
    options = BagOptions(position_offset_ns=-60 * 10**9)
    joined = BagSequence(write_bag(apart, tmp_path / 'joined', options))
    assert joined.trajectory is not None
    metric = joined.trajectory.in_frame(LocalFrame(joined.trajectory.origin()))  # type: ignore[arg-type]
    steps_m = np.diff(metric.poses_at(joined.stamps_ns, 10**9)[:, :2], axis=0)
    np.testing.assert_allclose(np.hypot(*steps_m.T), 1.25, atol=1e-3)


@pytest.mark.parametrize('start_ns', [0, END_NS - 10**9])
def test_positions_around_a_drive_have_stamps_that_messages_can_hold(
    street: Callable[..., Any], tmp_path: Path, start_ns: int
) -> None:
    read = BagSequence(write_bag(street(count=4, start_ns=start_ns), tmp_path / 'bag'))
    assert read.trajectory is not None
    assert read.trajectory.left_out == ()
    assert len(read.trajectory) < len(street(count=4).trajectory)


@dataclasses.dataclass(frozen=True)
class OneStamped:
    """A drive of which one scan has another stamp."""

    drive: Any
    index: int
    stamp_ns: int
    name: str = 'drive'
    layout: str = 'test'
    trajectory: Any = None

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        stamps_ns: NDArray[np.int64] = self.drive.stamps_ns.copy()
        stamps_ns[self.index] = self.stamp_ns
        return stamps_ns

    def __len__(self) -> int:
        return len(self.drive)

    def scan(self, index: int) -> PolarScan:
        scan: PolarScan = self.drive.scan(index)
        return dataclasses.replace(scan, stamp_ns=int(self.stamps_ns[index]))


@pytest.mark.parametrize(('index', 'stamp_ns'), [(0, -1), (3, 2**31 * 10**9), (3, 2**62)])
def test_a_scan_with_a_stamp_that_ros_cannot_hold_is_left_out(
    street: Callable[..., Any], tmp_path: Path, index: int, stamp_ns: int
) -> None:
    sequence = OneStamped(street(count=4), index, stamp_ns)
    with pytest.raises(RefusedInput, match=f'stamp {stamp_ns} ns: expected nanoseconds since 1970'):
        write_bag(sequence, tmp_path / 'bag')
    refused: list[int] = []
    bag = write_bag(sequence, tmp_path / 'bag', unreadable=lambda index, _: refused.append(index))
    assert (refused, len(BagSequence(bag))) == ([index], 3)
    last = OneStamped(street(count=4), 3, 2**31 * 10**9 - 1)
    assert BagSequence(write_bag(last, tmp_path / 'last')).stamps_ns[-1] == 2**31 * 10**9 - 1


@pytest.mark.parametrize(('index', 'stamp_ns'), [(0, 2 * 10**18), (-1, 0)])
def test_one_odd_stamp_at_an_end_takes_no_positions_away(
    street: Callable[..., Any], tmp_path: Path, index: int, stamp_ns: int
) -> None:
    sequence = street(count=8)
    odd = OneStamped(sequence, index, stamp_ns)
    odd = dataclasses.replace(odd, trajectory=sequence.trajectory)
    found = BagSequence(write_bag(odd, tmp_path / 'bag')).trajectory
    whole = BagSequence(write_bag(sequence, tmp_path / 'sound')).trajectory
    assert found is not None
    assert whole is not None
    assert len(found) >= 0.8 * len(whole)


def test_positions_moved_to_where_ros_has_no_time_are_left_out(street: Callable[..., Any], tmp_path: Path) -> None:
    sequence = street(count=12, start_ns=10**9)
    bag = BagSequence(write_bag(sequence, tmp_path / 'bag', BagOptions(position_offset_ns=-2 * 10**9)))
    assert bag.trajectory is not None
    known_ns = sequence.trajectory.stamps_ns - 2 * 10**9
    np.testing.assert_array_equal(bag.trajectory.stamps_ns, known_ns[known_ns >= 0])


def test_an_interrupted_run_leaves_nothing_that_looks_complete(street: Callable[..., Any], tmp_path: Path) -> None:
    def interrupt(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_bag(street(), tmp_path / 'bag', progress=interrupt)
    assert not (tmp_path / 'bag').exists()


def test_what_a_killed_run_leaves_is_refused_and_replaced(street: Callable[..., Any], tmp_path: Path) -> None:
    partial = tmp_path / 'bag.0123456789abcdef.partial'
    write_bag(street(count=3), tmp_path / 'whole')
    shutil.copytree(tmp_path / 'whole', partial / 'bag')
    (partial / 'bag' / 'metadata.yaml').unlink()
    with pytest.raises(DataError, match=r'no metadata\.yaml.*cut off'):
        Bag(partial / 'bag')
    write_bag(street(count=3), tmp_path / 'bag')
    assert not partial.exists()


def test_an_existing_bag_is_kept_without_overwrite(street: Callable[..., Any], tmp_path: Path) -> None:
    write_bag(street(count=2), tmp_path / 'bag')
    with pytest.raises(DataError, match=r'exists already.*--overwrite'):
        write_bag(street(count=3), tmp_path / 'bag')
    assert len(BagSequence(tmp_path / 'bag')) == 2
    write_bag(street(count=3), tmp_path / 'bag', BagOptions(overwrite=True))
    assert len(BagSequence(tmp_path / 'bag')) == 3


def test_a_folder_that_cannot_be_written_is_one_line(street: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('in the way')
    with pytest.raises(DataError, match='cannot be written'):
        write_bag(street(count=2), tmp_path / 'file' / 'bag')


@pytest.mark.parametrize('cut', [0, 100, 4000, -200])
def test_a_truncated_recording_is_refused_by_name(street: Callable[..., Any], tmp_path: Path, cut: int) -> None:
    folder = write_bag(street(count=3), tmp_path / 'bag')
    (file,) = folder.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:cut])
    with pytest.raises(DataError, match=r'bag: not a readable rosbag2 recording'), Bag(folder) as bag:
        list(bag.messages())


def test_a_foreign_file_is_refused_by_name(street: Callable[..., Any], tmp_path: Path) -> None:
    folder = write_bag(street(count=2), tmp_path / 'bag')
    (file,) = folder.glob('*.mcap')
    file.write_bytes(b'PK\x03\x04 not an mcap file' * 100)
    with pytest.raises(DataError, match=r'bag: not a readable rosbag2 recording'), Bag(folder) as bag:
        list(bag.messages())


def rewritten(path: Path, out: Path, change: Callable[[bytes], bytes]) -> Path:
    """The bag with the bytes of every message changed."""
    with Bag(path) as bag, Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=TYPES) for topic, kind in bag.topics.items()}
        for message in bag.messages():
            writer.write(connections[message.topic], message.log_ns, change(message.cdr))
    return out


def test_what_follows_a_message_is_ignored(street: Callable[..., Any], tmp_path: Path) -> None:
    sequence = street(count=3)
    whole = write_bag(sequence, tmp_path / 'whole')
    longer = BagSequence(rewritten(whole, tmp_path / 'longer', lambda cdr: cdr + bytes(4008)))
    for index in range(3):
        np.testing.assert_array_equal(longer.scan(index).power, sequence.scan(index).power)
    shorter = rewritten(whole, tmp_path / 'shorter', lambda cdr: cdr[:-40])
    with Bag(shorter) as bag, pytest.raises(DataError, match='not a readable'):
        bag.decode(next(bag.messages()))


def test_messages_of_a_machine_with_the_other_order_of_bytes_are_read(
    street: Callable[..., Any], tmp_path: Path
) -> None:
    sequence = street(count=3)
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(SCANS, IMAGE_TYPE, typestore=TYPES)
        for recorded in scans(sequence):
            cdr = TYPES.serialize_cdr(recorded.message, IMAGE_TYPE, little_endian=False)
            writer.write(connection, recorded.log_ns, cdr)
    bag = BagSequence(tmp_path / 'bag')
    np.testing.assert_array_equal(bag.stamps_ns, sequence.stamps_ns)
    np.testing.assert_array_equal(bag.scan(1).power, sequence.scan(1).power)


@pytest.mark.parametrize('little_endian', [True, False])
def test_a_stamp_is_replaced_in_the_order_of_bytes_of_its_message(
    street: Callable[..., Any], little_endian: bool
) -> None:
    message = next(iter(scans(street(count=1)))).message
    cdr = bytes(TYPES.serialize_cdr(message, IMAGE_TYPE, little_endian=little_endian))
    moved = with_header_stamp(cdr, 5 * 10**9 + 7)
    changed: Any = TYPES.deserialize_cdr(moved, IMAGE_TYPE)
    stamp = changed.header.stamp
    assert (stamp.sec, stamp.nanosec, header_stamp_ns(moved)) == (5, 7, 5 * 10**9 + 7)
    assert with_header_stamp(moved, header_stamp_ns(cdr)) == cdr


def test_the_message_of_a_live_driver_is_read_from_a_bag(real_data: Path, tmp_path: Path) -> None:
    cdr = (real_data / 'navtech_ros2' / 'b_scan_image.cdr').read_bytes()
    with Writer(tmp_path / 'live', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/radar_data/b_scan_image', IMAGE_TYPE, typestore=TYPES)
        writer.write(connection, header_stamp_ns(cdr), cdr)
    assert BagSequence(tmp_path / 'live').scan(0).power.shape == (400, 6848)


def test_a_bag_that_is_replaced_while_it_is_read_is_one_line(street: Callable[..., Any], tmp_path: Path) -> None:
    sequence = BagSequence(write_bag(street(count=3), tmp_path / 'bag'))
    write_bag(street(count=3, start_ns=10**18), tmp_path / 'bag', BagOptions(overwrite=True))
    with pytest.raises(DataError, match='bag: changed while it was read: it no longer holds the scan of'):
        sequence.scan(1)
    with pytest.raises(DataError, match='changed while it was read'):
        write_bag(sequence, tmp_path / 'other')


def test_damage_within_a_chunk_is_refused(street: Callable[..., Any], tmp_path: Path) -> None:
    folder = write_bag(street(count=6), tmp_path / 'bag')
    (file,) = folder.glob('*.mcap')
    data = bytearray(file.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(64)
    file.write_bytes(data)
    with pytest.raises(DataError, match=r'not a readable'):
        sequence = BagSequence(folder)
        for index in range(len(sequence)):
            sequence.scan(index)


def test_bags_are_distinguished_from_other_folders(street: Callable[..., Any], tmp_path: Path) -> None:
    assert is_bag(write_bag(street(count=2), tmp_path / 'bag'))
    (tmp_path / 'other').mkdir()
    assert not is_bag(tmp_path / 'other')
