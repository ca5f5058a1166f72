"""Bags as people have them: those that can be read are read, for the others one line says what makes them readable."""

from __future__ import annotations

import os
import shlex
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from recorded_topics import fixes, record, scans
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.check import check_bag
from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.topics import SCANS
from offradar_ros.recordings.source import is_bag, open_source


@pytest.fixture
def drive(street: Callable[..., Any]) -> Any:
    return street(count=3)


@pytest.fixture
def mcap(drive: Any, tmp_path: Path) -> Path:
    return record(tmp_path / 'town', scans(drive), fixes(drive))


@pytest.fixture
def db3(drive: Any, tmp_path: Path) -> Path:
    return record(tmp_path / 'square', scans(drive), fixes(drive), plugin=StoragePlugin.SQLITE3)


def edit(folder: Path, **values: Any) -> Path:
    """Change what metadata.yaml says."""
    file = folder / 'metadata.yaml'
    tree = yaml.safe_load(file.read_text())
    tree['rosbag2_bagfile_information'].update(values)
    file.write_text(yaml.safe_dump(tree))
    return folder


def require_whole(path: Path, drive: Any) -> None:
    """The scans and positions of the drive are in the recording."""
    assert is_bag(path)
    opened = open_source(path)
    np.testing.assert_array_equal(opened.stamps_ns, drive.stamps_ns)
    for index in range(len(drive)):
        np.testing.assert_array_equal(opened.scan(index).power, drive.scan(index).power)
    assert opened.trajectory is not None
    assert len(opened.trajectory) == len(drive.trajectory)


def refusal(path: Path) -> str:
    """The one line for a recording that cannot be read."""
    assert is_bag(path)
    with pytest.raises(DataError) as refused:
        open_source(path)
    text = str(refused.value)
    assert '\n' not in text
    assert 'report' not in text
    assert text.startswith(f'{path}: ')
    return text


@pytest.mark.parametrize('kind', ['mcap', 'db3'])
def test_a_folder_and_the_file_alone_hold_the_same(kind: str, drive: Any, request: pytest.FixtureRequest) -> None:
    folder: Path = request.getfixturevalue(kind)
    require_whole(folder, drive)
    (file,) = folder.glob(f'*.{kind}')
    require_whole(Path(shutil.copy(file, folder.parent / f'alone.{kind}')), drive)


@pytest.mark.parametrize('kind', ['mcap', 'db3'])
@pytest.mark.parametrize(
    'values',
    [{'storage_identifier': ''}, {'storage_identifier': 'of_another_vendor'}, {'version': 10, 'new': {'key': 1}}],
)
def test_metadata_of_another_version_or_storage_does_not_matter(
    kind: str, values: dict[str, Any], drive: Any, request: pytest.FixtureRequest
) -> None:
    require_whole(edit(request.getfixturevalue(kind), **values), drive)


def test_metadata_that_calls_the_storage_another_does_not_matter(mcap: Path, drive: Any) -> None:
    require_whole(edit(mcap, storage_identifier='sqlite3'), drive)


def test_a_recording_in_several_files_is_one(street: Callable[..., Any], tmp_path: Path) -> None:
    whole = street(count=5)
    first = record(tmp_path / 'first', list(scans(whole))[:2])
    second = record(tmp_path / 'second', list(scans(whole))[2:], fixes(whole))
    shutil.copy(second / 'second.mcap', first)
    edit(first, version=10, relative_file_paths=['first.mcap', 'second.mcap'])
    require_whole(first, whole)
    with Bag(first) as bag:
        assert bag.counts == {'/gps/fix': len(whole.trajectory), '/radar_data/b_scan_image': 5}
        assert (bag.start_ns, bag.end_ns) == (whole.trajectory.stamps_ns[0], whole.trajectory.stamps_ns[-1] + 1)


@pytest.mark.parametrize('version', [9, 10])
def test_files_are_read_in_order_of_time_however_they_are_listed(
    street: Callable[..., Any], tmp_path: Path, version: int
) -> None:
    whole = street(count=6)
    parts = [record(tmp_path / str(k), list(scans(whole))[2 * k : 2 * k + 2]) for k in range(3)]
    folder = edit(
        parts[0],
        version=version,
        relative_file_paths=['2.mcap', '0.mcap', '1.mcap'],
        topics_with_message_count=[
            {**topic, 'message_count': 6}
            for topic in yaml.safe_load((parts[0] / 'metadata.yaml').read_text())['rosbag2_bagfile_information'][
                'topics_with_message_count'
            ]
        ],
    )
    for part in parts[1:]:
        shutil.copy(part / f'{part.name}.mcap', folder)
    with Bag(folder) as bag:
        assert [message.log_ns for message in bag.messages()] == whole.stamps_ns.tolist()


@pytest.mark.parametrize('version', [9, 10])
def test_a_file_that_is_listed_twice_is_refused(mcap: Path, version: int) -> None:
    text = refusal(edit(mcap, version=version, relative_file_paths=['town.mcap', 'town.mcap']))
    assert 'names a file twice' in text


def compressed(path: Path, drive: Any, mode: CompressionMode, plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        made = {}
        for row in sorted([*scans(drive), *fixes(drive)], key=lambda row: row.log_ns):
            if row.topic not in made:
                made[row.topic] = writer.add_connection(row.topic, row.msgtype, typestore=TYPES)
            writer.write(made[row.topic], row.log_ns, TYPES.serialize_cdr(row.message, row.msgtype))
    return path


@pytest.mark.parametrize('mode', [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_compressed_recordings(mode: CompressionMode, plugin: StoragePlugin, drive: Any, tmp_path: Path) -> None:
    require_whole(compressed(tmp_path / 'small', drive, mode, plugin), drive)
    (file,) = (f for f in (tmp_path / 'small').iterdir() if f.name != 'metadata.yaml')
    alone = Path(shutil.copy(file, tmp_path / file.name))
    text = refusal(alone)
    assert 'give the folder with its metadata.yaml' in text
    if mode == CompressionMode.FILE:
        assert f'zstd -d {alone}' in text
        (tmp_path / 'small' / 'metadata.yaml').unlink()
        assert 'no metadata.yaml' in refusal(tmp_path / 'small')


def test_files_that_were_compressed_by_hand_are_read(drive: Any, tmp_path: Path) -> None:
    """The command zstd names them differently."""
    folder = compressed(tmp_path / 'small', drive, CompressionMode.FILE)
    (folder / 'small.mcap.zstd').rename(folder / 'small.mcap.zst')
    require_whole(edit(folder, relative_file_paths=['small.mcap.zst']), drive)


def test_the_way_out_is_one_for_compressed_recordings(drive: Any, tmp_path: Path) -> None:
    """ros2 bag reindex does not read them."""
    files = edit(compressed(tmp_path / 'files', drive, CompressionMode.FILE), topics_with_message_count=[])
    reindex = f'zstd -d --rm {files}/*.zstd && ros2 bag reindex -s mcap {files} writes it again'
    assert reindex in refusal(files)
    (files / 'metadata.yaml').write_text('')
    assert reindex in refusal(files)
    messages = edit(compressed(tmp_path / 'messages', drive, CompressionMode.MESSAGE), topics_with_message_count=[])
    assert 'copy it again, ros2 bag reindex does not read messages that are compressed' in refusal(messages)


def test_compression_under_metadata_of_another_version_names_the_way_out(drive: Any, tmp_path: Path) -> None:
    folder = record(tmp_path / 'next', scans(drive))
    edit(folder, version=10, compression_mode='MESSAGE', compression_format='zstd')
    assert 'ros2 bag convert' in refusal(folder)


@pytest.mark.parametrize(('kind', 'storage'), [('mcap', 'mcap'), ('db3', 'sqlite3')])
def test_without_metadata_the_command_that_writes_it_is_named(
    kind: str, storage: str, request: pytest.FixtureRequest
) -> None:
    folder: Path = request.getfixturevalue(kind)
    (folder / 'metadata.yaml').unlink()
    text = refusal(folder)
    assert 'no metadata.yaml' in text
    assert f'ros2 bag reindex -s {storage} {folder} writes it' in text
    assert f'or read {folder / folder.name}.{kind} by itself' in text


@pytest.mark.parametrize(
    'content',
    ['', 'rosbag2_bagfile_information:\n', 'rosbag2_bagfile_information: {version: 9', '[1, 2]', 'a: ' + '[' * 200],
)
def test_metadata_that_is_damaged_is_written_again(mcap: Path, content: str) -> None:
    (mcap / 'metadata.yaml').write_text(content)
    text = refusal(mcap)
    assert '(metadata.yaml is damaged or empty (' in text
    assert f': ros2 bag reindex -s mcap {mcap} writes it again' in text


def test_metadata_that_repeats_itself_without_end_is_refused(mcap: Path) -> None:
    levels = [f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, 12)]
    (mcap / 'metadata.yaml').write_text('\n'.join(['a0: &a0 [x]', *levels]))
    assert 'metadata.yaml is damaged' in refusal(mcap)


def test_a_file_that_is_missing_is_named(mcap: Path) -> None:
    (mcap / 'town.mcap').rename(mcap / 'town drive.mcap')
    text = refusal(mcap)
    assert 'metadata.yaml names town.mcap, which is not there' in text
    assert f'ros2 bag reindex -s mcap {mcap}' in text


@pytest.mark.parametrize('cut', [9, 100, 4000, -1, -20_000])
@pytest.mark.parametrize('metadata', [True, False])
def test_an_mcap_that_was_cut_off_names_what_saves_the_rest(mcap: Path, cut: int, metadata: bool) -> None:
    file = mcap / 'town.mcap'
    file.write_bytes(file.read_bytes()[:cut])
    if not metadata:
        (mcap / 'metadata.yaml').unlink()
    for path in (mcap, file):
        assert (
            f'town.mcap was cut off, it has no end: mcap recover {file} -o {mcap / "town_recovered.mcap"}'
            in refusal(path)
        )


def test_an_empty_file_holds_nothing(mcap: Path) -> None:
    (mcap / 'town.mcap').write_bytes(b'')
    assert 'town.mcap is empty' in refusal(mcap)


def test_a_database_that_was_cut_off_names_what_saves_the_rest(db3: Path) -> None:
    file = db3 / 'square.db3'
    file.write_bytes(file.read_bytes()[:-8192])
    assert f'square.db3 was cut off: sqlite3 {file} .recover' in refusal(db3)


def test_a_database_of_which_a_part_lies_beside_it_is_not_read_without_it(db3: Path, drive: Any) -> None:
    file = db3 / 'square.db3'
    with sqlite3.connect(file) as connection:
        connection.execute('PRAGMA journal_mode=WAL')
        connection.execute('DELETE FROM messages WHERE topic_id = 1')
        connection.commit()
        # As a recorder that was killed leaves both files.
        for name in ('square.db3', 'square.db3-wal'):
            shutil.copy(db3 / name, db3 / f'{name}.kept')
    connection.close()
    for name in ('square.db3', 'square.db3-wal'):
        (db3 / f'{name}.kept').replace(db3 / name)
    text = refusal(db3)
    assert 'square.db3-wal beside it holds a part of it' in text
    assert f"sqlite3 {file} 'PRAGMA journal_mode=DELETE' joins them" in text
    joined = sqlite3.connect(file)
    joined.execute('PRAGMA journal_mode=DELETE')
    joined.close()
    # metadata.yaml is still that of all messages.
    with pytest.raises(DataError, match='ros2 bag reindex'):
        Bag(db3)
    with Bag(file) as bag:
        assert 0 < sum(1 for _ in bag.messages()) < len(drive) + len(drive.trajectory)


def test_a_recording_of_ros_1_names_its_converter(tmp_path: Path) -> None:
    old = tmp_path / 'old drives' / 'drive.bag'
    old.parent.mkdir()
    old.write_bytes(b'#ROSBAG V2.0\n' + bytes(4096))
    command = f"rosbags-convert --src '{old}' --dst '{old.with_suffix('')}' makes a rosbag2 folder of it"
    assert refusal(old) == f'{old}: a recording of ROS 1: {command}'
    assert refusal(old.parent) == f'{old.parent}: holds drive.bag, a recording of ROS 1: {command}'


@pytest.mark.parametrize(
    ('content', 'expected'),
    [
        (b'\x1f\x8b\x08' + bytes(100), 'gzip archive: unpack it first'),
        (b'PK\x03\x04' + bytes(100), 'zip archive: unpack it first'),
        (b'Dear all', 'neither MCAP nor SQLite'),
        (bytes(64), 'neither MCAP nor SQLite'),
    ],
)
def test_another_file_of_that_name_is_said_to_be_one(tmp_path: Path, content: bytes, expected: str) -> None:
    file = tmp_path / 'drive.mcap'
    file.write_bytes(content)
    assert expected in refusal(file)


def test_a_wrong_suffix_is_named(mcap: Path, db3: Path, tmp_path: Path) -> None:
    renamed = Path(shutil.copy(mcap / 'town.mcap', tmp_path / 'town.db3'))
    assert 'town.db3 is an MCAP file: rename it to town.mcap' in refusal(renamed)
    renamed = Path(shutil.copy(db3 / 'square.db3', tmp_path / 'recording'))
    assert 'recording is an SQLite file: rename it to recording.db3' in refusal(renamed)


def test_a_pipe_is_not_waited_for(mcap: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'live.mcap')
    assert 'not a regular file' in refusal(tmp_path / 'live.mcap')
    (mcap / 'metadata.yaml').unlink()
    os.mkfifo(mcap / 'metadata.yaml')
    assert 'metadata.yaml cannot be read: Not a regular file' in refusal(mcap)


def test_names_are_quoted_in_commands(drive: Any, tmp_path: Path) -> None:
    folder = record(tmp_path / "Fahrt München – 1 (it's a copy)", scans(drive), fixes(drive))
    require_whole(folder, drive)
    (folder / 'metadata.yaml').unlink()
    assert f'reindex -s mcap {shlex.quote(str(folder))} writes' in refusal(folder)


def test_files_beside_the_scans_of_a_data_set_do_not_make_it_a_bag(radiate_folder: Path) -> None:
    (radiate_folder / 'notes.bag').write_bytes(b'#ROSBAG V2.0\n')
    assert not is_bag(radiate_folder)
    assert len(open_source(radiate_folder)) == 5


@pytest.mark.parametrize('is_odd_first', [True, False])
def test_a_topic_of_two_types_is_read_as_the_one_with_more_messages(
    drive: Any, tmp_path: Path, is_odd_first: bool
) -> None:
    flag = TYPES.types['std_msgs/msg/Bool'](data=True)
    rows = list(scans(drive))
    odd = [rows[0]._replace(msgtype='std_msgs/msg/Bool', message=flag)]
    with Bag(record(tmp_path / 'mixed', *((odd, rows) if is_odd_first else (rows, odd)))) as bag:
        assert bag.topics == {'/radar_data/b_scan_image': 'sensor_msgs/msg/Image'}
        assert bag.left_out == {('/radar_data/b_scan_image', 'std_msgs/msg/Bool'): 1}
        assert {message.msgtype for message in bag.messages()} == {'sensor_msgs/msg/Image'}
    assert len(BagSequence(tmp_path / 'mixed')) == 3


def test_a_message_without_a_stamp_is_one_unreadable_scan(drive: Any, tmp_path: Path) -> None:
    rows = list(scans(drive))
    rows[1] = rows[1]._replace(message=b'\0\1\0\0ab')
    sequence = BagSequence(record(tmp_path / 'short', rows))
    assert len(sequence) == 3
    with pytest.raises(DataError, match='not a readable'):
        sequence.scan(1)
    np.testing.assert_array_equal(sequence.scan(2).power, drive.scan(2).power)


def test_what_macos_puts_beside_its_files_is_no_recording(street_bag: Callable[..., Path]) -> None:
    bag = street_bag('bag', count=2)
    (bag / '._bag.mcap').write_bytes(b'\0\5\x16\7' * 50)
    with Bag(bag) as opened:
        assert opened.counts[SCANS] == 2
    (bag / 'metadata.yaml').unlink()
    with pytest.raises(DataError, match=r'or read .*/bag\.mcap by itself'):
        Bag(bag)


def test_a_file_that_the_metadata_does_not_name_is_told_of(street_bag: Callable[..., Path]) -> None:
    bag = street_bag('bag', count=2)
    shutil.copy(bag / 'bag.mcap', bag / 'bag_1.mcap')
    (problem,) = check_bag(bag).problems
    assert problem.text.startswith('bag_1.mcap: in the folder, but not in metadata.yaml, so not read: ')
