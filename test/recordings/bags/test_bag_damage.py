"""A bag is read as it was written, or refused in one line: damage, contradictions, and files made to exhaust memory."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
import yaml
from backports import zstd
from bounded_process import refusal
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

from offradar_ros.errors import DataError
from offradar_ros.recordings.bags import bag_check
from offradar_ros.recordings.bags.bag_check import check_bag_files
from offradar_ros.recordings.bags.mcap_check import MAX_CHANNELS, check_mcap
from offradar_ros.recordings.bags.mcap_checksums import write_checksums
from offradar_ros.recordings.bags.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEAD,
    MAGIC,
    MESSAGE,
    SCHEMA,
    Damage,
    top_records,
)
from offradar_ros.recordings.bags.reader import TYPES, Bag
from offradar_ros.recordings.bags.topics import FIX, FIX_TYPE

SHIPPED = Path(__file__).resolve().parents[3] / 'bags' / 'session_1'
SEED = 11
HEADER = 0x01


def content_of(path: Path) -> Any:
    """All that is read from a bag."""
    with Bag(path) as bag:
        messages = [(m.topic, m.msgtype, m.log_ns, m.cdr) for m in bag.messages()]
        return bag.topics, bag.counts, bag.start_ns, bag.end_ns, messages


def refused_or(path: Path, expected: Any) -> bool:
    """Whether a bag is refused, in one line; if it is read, it must hold what is expected."""
    try:
        found = content_of(path)
    except DataError as error:
        assert len(str(error).splitlines()) == 1
        assert str(error).startswith(str(path))
        return True
    assert found == expected
    return False


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    shutil.copytree(SHIPPED, tmp_path / 'session_1')
    return tmp_path / 'session_1'


def flipped(content: bytes, random_: random.Random, low: int = 0) -> bytes:
    damaged = bytearray(content)
    damaged[random_.randrange(low, len(content))] ^= 1 << random_.randrange(8)
    return bytes(damaged)


def test_a_flipped_bit_of_a_recording_is_always_noticed(bag: Path) -> None:
    file, random_ = bag / 'session_1.mcap', random.Random(SEED)
    whole = file.read_bytes()
    for number in range(80):
        # Tables and footer are at the end, and smaller than what they lead to.
        file.write_bytes(flipped(whole, random_, len(whole) - 5000 if number % 2 else 0))
        assert refused_or(bag, None)
    file.write_bytes(whole)
    assert not refused_or(bag, content_of(SHIPPED))


def test_a_flipped_bit_of_metadata_is_noticed_or_changes_nothing(bag: Path) -> None:
    file, random_, expected = bag / 'metadata.yaml', random.Random(SEED), content_of(SHIPPED)
    whole = file.read_bytes()
    refused = 0
    for _ in range(150):
        file.write_bytes(flipped(whole, random_))
        refused += refused_or(bag, expected)
    assert refused > 50


def test_without_checksums_no_message_is_lost_unnoticed(bag: Path) -> None:
    file, random_ = bag / 'session_1.mcap', random.Random(SEED)
    written = bytearray(file.read_bytes())
    with file.open('rb') as opened:
        records = list(top_records(opened))
    for record in records:
        if record.kind == CHUNK:
            written[record.body + 24 : record.body + 28] = bytes(4)
        elif record.kind == DATA_END:
            written[record.body : record.end] = bytes(4)
            tables = record.end
        elif record.kind == FOOTER:
            written[record.body + 16 : record.end] = bytes(4)
    file.write_bytes(written)
    assert content_of(bag) == content_of(SHIPPED)
    for _ in range(150):
        file.write_bytes(flipped(bytes(written), random_, tables))
        refused_or(bag, content_of(SHIPPED))


def test_what_is_written_has_every_checksum_of_the_format(street: Callable[..., Any], tmp_path: Path) -> None:
    reading = pytest.importorskip('mcap.stream_reader')
    from offradar_ros.recordings.bags.writer import write_bag  # noqa: PLC0415

    file = write_bag(street(count=3), tmp_path / 'bag') / 'bag.mcap'
    content = file.read_bytes()
    with file.open('rb') as opened:
        records = list(top_records(opened))
        opened.seek(0)
        assert list(reading.StreamReader(opened, validate_crcs=True).records)
    kinds = {record.kind: record for record in records}
    assert content[kinds[CHUNK].body + 24 :][:4] != bytes(4)
    assert content[kinds[DATA_END].body :][:4] == struct.pack('<I', zlib.crc32(content[: kinds[DATA_END].start]))
    end = kinds[FOOTER].body + 16
    assert content[end : end + 4] == struct.pack('<I', zlib.crc32(content[kinds[DATA_END].end : end]))
    again = file.read_bytes()
    write_checksums(file)
    assert file.read_bytes() == again


@pytest.mark.parametrize('length', [0, 8])
def test_checksums_are_written_over_nothing_else(lone: Path, length: int) -> None:
    lone.write_bytes(mcap(SMALL).replace(record(DATA_END, bytes(4)), record(DATA_END, bytes(length))))
    content = lone.read_bytes()
    with pytest.raises(Damage, match='no end of its data'):
        write_checksums(lone)
    assert lone.read_bytes() == content


def test_a_checked_bag_is_checked_again_when_it_changes(bag: Path) -> None:
    assert check_bag_files(bag) == check_bag_files(bag)
    file = bag / 'session_1.mcap'
    file.write_bytes(flipped(file.read_bytes(), random.Random(SEED), 2000))
    with pytest.raises(DataError, match='not a readable rosbag2 recording'):
        check_bag_files(bag)


@pytest.mark.parametrize('is_in_place', [True, False])
def test_a_bag_of_another_size_or_another_file_is_checked_again_whatever_its_time(bag: Path, is_in_place: bool) -> None:
    """As after a copy that keeps times."""
    check_bag_files(bag)
    file = bag / 'session_1.mcap'
    status, content = file.stat(), file.read_bytes()
    other = file if is_in_place else bag / 'other'
    other.write_bytes(content[:-1] if is_in_place else flipped(content, random.Random(SEED), 2000))
    other.replace(file)
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert (file.stat().st_ino == status.st_ino) == is_in_place
    with pytest.raises(DataError, match='not a readable rosbag2 recording'):
        check_bag_files(bag)


def test_a_file_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r'gone\.mcap: cannot be read \(No such file or directory\)'):
        check_bag_files(tmp_path / 'gone.mcap')


def test_a_bag_that_is_refused_is_closed(bag: Path) -> None:
    tree = yaml.safe_load((bag / 'metadata.yaml').read_text())
    CHANGES['a quality of service'][0](tree['rosbag2_bagfile_information'])
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(tree))
    # Who handles the error holds what raised it.
    with pytest.raises(DataError) as refused:
        Bag(bag)
    assert refused.value.__traceback__ is not None
    assert bag / 'session_1.mcap' not in [each.resolve() for each in Path('/proc/self/fd').iterdir()]


def test_each_of_many_files_is_checked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = written(tmp_path / 'bag', CompressionMode.NONE, StoragePlugin.MCAP, b'\0\1\0\0')
    tree = yaml.safe_load((bag / 'metadata.yaml').read_text())
    told = tree['rosbag2_bagfile_information']
    told['relative_file_paths'] = [f'{number}.mcap' for number in range(300)]
    told['topics_with_message_count'][0]['message_count'] *= 300
    for name in told['relative_file_paths']:
        shutil.copy(bag / 'bag.mcap', bag / name)
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(tree))
    assert check_bag_files(bag).counts == {(FIX, FIX_TYPE): 900}
    monkeypatch.setattr(bag_check, 'check_mcap', None)
    assert check_bag_files(bag).counts == {(FIX, FIX_TYPE): 900}


CHANGES: dict[str, tuple[Callable[[Any], object], str]] = {
    'a number of messages': (
        lambda told: told['topics_with_message_count'][0].update(message_count=9),
        r'says 9 messages of /radar_data/b_scan_image \(.*\), its files hold 10: ros2 bag reindex',
    ),
    'a topic': (
        lambda told: told['topics_with_message_count'][1]['topic_metadata'].update(name='/gps/fax'),
        r'says 30 messages of /gps/fax .*, its files hold 0',
    ),
    'a type': (
        lambda told: told['topics_with_message_count'][0]['topic_metadata'].update(type='sensor_msgs/msg/Imu'),
        r'says 0 messages of /radar_data/b_scan_image \(sensor_msgs/msg/Image\), its files hold 10',
    ),
    'a topic less': (
        lambda told: told['topics_with_message_count'].pop(),
        r'says 0 messages of /ground_truth/odometry',
    ),
    'a file twice': (lambda told: told['relative_file_paths'].append('session_1.mcap'), 'names a file twice'),
    'no topics': (lambda told: told.pop('topics_with_message_count'), 'metadata.yaml is damaged'),
    'a quality of service': (
        lambda told: told['topics_with_message_count'][0]['topic_metadata'].update(
            offered_qos_profiles=[
                {
                    **{'history': 'keep_last', 'depth': 5, 'reliability': 'reliable', 'durability': 'volatile'},
                    **{key: {'sec': 0, 'nsec': 0} for key in ('deadline', 'lifespan', 'liveliness_lease_duration')},
                    **{'liveliness': 'automatic', 'avoid_ros_namespace_conventions': False},
                }
            ]
        ),
        'says of /radar_data/b_scan_image another type, format or QoS than its file',
    ),
}


@pytest.mark.parametrize('change', CHANGES)
def test_metadata_that_contradicts_its_file_is_refused(bag: Path, change: str) -> None:
    make, expected = CHANGES[change]
    tree = yaml.safe_load((bag / 'metadata.yaml').read_text())
    make(tree['rosbag2_bagfile_information'])
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(tree))
    with pytest.raises(DataError, match=expected):
        Bag(bag)


def test_times_are_those_of_the_messages(bag: Path) -> None:
    tree = yaml.safe_load((bag / 'metadata.yaml').read_text())
    told = tree['rosbag2_bagfile_information']
    told['starting_time']['nanoseconds_since_epoch'] -= 10**9
    told['duration']['nanoseconds'] += 10**10
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(tree))
    assert content_of(bag) == content_of(SHIPPED)


# Files made by hand: each record is right but for what a case is about.


def text(value: str | bytes) -> bytes:
    content = value if isinstance(value, bytes) else value.encode()
    return struct.pack('<I', len(content)) + content


def record(kind: int, body: bytes, length: int | None = None) -> bytes:
    return struct.pack('<BQ', kind, len(body) if length is None else length) + body


def schema(number: int, name: str = FIX_TYPE, definition: bytes = b'') -> bytes:
    return record(SCHEMA, struct.pack('<H', number) + text(name) + text('ros2msg') + text(definition))


def channel(number: int, topic: str = FIX, qos: str = '') -> bytes:
    metadata = text('offered_qos_profiles') + text(qos)
    return record(CHANNEL, struct.pack('<HH', number, 1) + text(topic) + text('cdr') + text(metadata))


def message(number: int, log_ns: int, data: bytes = b'\0\1\0\0') -> bytes:
    return record(MESSAGE, struct.pack('<HIQQ', number, 0, log_ns, log_ns) + data)


def chunk(content: bytes, compression: str = '', compressed: bytes | None = None, size: int | None = None) -> bytes:
    packed = content if compressed is None else compressed
    head = struct.pack('<QQQI', 0, 100, len(content) if size is None else size, 0)
    return record(CHUNK, head + text(compression) + struct.pack('<Q', len(packed)) + packed)


def index(file: bytes, at: int, channels: dict[int, int], size: int) -> bytes:
    """The entry of the index for the chunk at `at` of a file, with a number of messages for each channel."""
    (length,) = struct.unpack_from('<Q', file, at + 1)
    offsets, place = b'', at + HEAD + length
    for number, count in channels.items():
        offsets += struct.pack('<HQ', number, place)
        place += 15 + 16 * count
    head = struct.pack('<QQQQ', 0, 100, at, HEAD + length) + text(offsets)
    return record(
        CHUNK_INDEX,
        head + struct.pack('<Q', place - at - HEAD - length) + text('') + struct.pack('<QQ', size, size),
    )


START = MAGIC + record(HEADER, text('ros2') + text('test'))


def mcap(data: bytes, summary: bytes = b'') -> bytes:
    """A file of these records, without checksums."""
    content = START + data + record(DATA_END, bytes(4))
    start = len(content) if summary else 0
    return content + summary + record(FOOTER, struct.pack('<QQI', start, 0, 0)) + MAGIC


DESCRIBED = schema(1) + channel(1)
SMALL = DESCRIBED + message(1, 5) + message(1, 6)


@pytest.fixture
def lone(tmp_path: Path) -> Path:
    return tmp_path / 'lone.mcap'


def test_a_file_made_by_hand_is_read(lone: Path) -> None:
    lone.write_bytes(mcap(SMALL))
    assert check_mcap(lone).counts == {(FIX, FIX_TYPE): 2}
    at = len(START)
    lone.write_bytes(mcap(chunk(SMALL), DESCRIBED + index(START + chunk(SMALL), at, {1: 2}, len(SMALL))))
    facts = check_mcap(lone)
    assert (facts.counts, facts.start_ns, facts.end_ns) == ({(FIX, FIX_TYPE): 2}, 5, 7)
    with Bag(lone) as bag:
        assert len(list(bag.messages())) == 2


def test_counts_are_those_of_the_messages(lone: Path) -> None:
    statistics = struct.pack('<QHIIIIQQ', 9, 1, 1, 0, 0, 0, 1, 99) + text(struct.pack('<HQ', 1, 9))
    lone.write_bytes(mcap(SMALL, DESCRIBED + record(0x0B, statistics)))
    with Bag(lone) as bag:
        assert (bag.counts, bag.start_ns, bag.end_ns) == ({FIX: 2}, 5, 7)


def lost() -> dict[str, bytes]:
    """Files of which a reader would leave messages out without a word."""
    content, at = chunk(SMALL), len(START)
    entry = index(START + content, at, {1: 2}, len(SMALL))
    second = chunk(message(1, 7))
    return {
        'no index of the channel': mcap(content, DESCRIBED + index(START + content, at, {}, len(SMALL))),
        'empty index of the channel': mcap(content, DESCRIBED + index(START + content, at, {1: 0}, len(SMALL))),
        'no index of a chunk': mcap(content + second, DESCRIBED + entry),
        'one chunk twice': mcap(content, DESCRIBED + entry + entry),
        'messages in no chunk': mcap(content + message(1, 8), DESCRIBED + entry),
        'channel not in the summary': mcap(content, schema(1) + channel(2) + entry),
        'other topic in the summary': mcap(content, schema(1) + channel(1, '/other') + entry),
        'other type in the summary': mcap(content, schema(1, 'other/msg/Type') + channel(1) + entry),
        'channel not described': mcap(schema(1) + message(1, 5)),
        'chunk elsewhere': mcap(content, DESCRIBED + entry.replace(struct.pack('<Q', at), struct.pack('<Q', at + 1))),
        'chunk of another time': mcap(DESCRIBED + chunk(message(1, 101))),
        'a message too short': mcap(DESCRIBED + record(MESSAGE, bytes(21))),
        'no end of the data': START + SMALL + record(FOOTER, bytes(20)) + MAGIC,
        'no footer': START + SMALL + record(DATA_END, bytes(4)) + MAGIC,
        'data after the footer': mcap(SMALL)[: -len(MAGIC)] + b'more' + MAGIC,
        'two channels of one id': mcap(DESCRIBED + channel(1, '/other') + message(1, 5)),
        'a record of kind 0': mcap(SMALL + record(0, b'')),
        'a chunk in a chunk': mcap(chunk(chunk(SMALL))),
        'a cut record in a chunk': mcap(chunk(SMALL[:-1])),
        'summary elsewhere': mcap(SMALL, DESCRIBED)[: -len(MAGIC) - 20] + bytes([9]) + mcap(SMALL, DESCRIBED)[-27:],
    }


@pytest.mark.parametrize('case', lost())
def test_what_would_lose_messages_is_refused(lone: Path, case: str) -> None:
    lone.write_bytes(lost()[case])
    with pytest.raises(Damage):
        check_mcap(lone)
    with pytest.raises(DataError, match=r'lone\.mcap: not a readable rosbag2 recording \(.*mcap recover'):
        Bag(lone)


GIANT = 10**10


ZEROS = bytes(32 * 2**20)
TIMES = 64


def inflating(compression: str, size: int) -> bytes:
    """A file whose one chunk, of one frame, inflates to 2 GB and claims `size` bytes."""
    if compression == 'zstd':
        zstd_frame = zstd.ZstdCompressor()
        parts = [*(zstd_frame.compress(ZEROS) for _ in range(TIMES)), zstd_frame.flush()]
    else:
        lz4_frame = lz4.frame.LZ4FrameCompressor()
        parts = [lz4_frame.begin(), *(lz4_frame.compress(ZEROS) for _ in range(TIMES)), lz4_frame.flush()]
    return mcap(chunk(b'', compression, b''.join(parts), size))


def many(compression: str, frame: bytes) -> bytes:
    """A file whose one chunk is of 4 MB of such frames."""
    return mcap(chunk(b'', compression, frame * (4 * 2**20 // len(frame)), 10))


BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    'a record of 8 EiB': (lambda: START + record(MESSAGE, b'', 2**63) + MAGIC, 'beyond the end of the file'),
    'a chunk that claims 10 GB': (lambda: mcap(chunk(b'', 'zstd', zstd.compress(b'x'), GIANT)), 'claims 10000000000'),
    'zstd of 2 GB that claims little': (lambda: inflating('zstd', 1000), 'expected 1000 bytes, got more'),
    'lz4 of 2 GB that claims little': (lambda: inflating('lz4', 1000), 'expected 1000 bytes, got more'),
    'zstd of 2 GB that claims it': (lambda: inflating('zstd', TIMES * len(ZEROS)), 'claims 2147483648'),
    'empty zstd frames': (lambda: many('zstd', zstd.compress(b'')), 'more than 64 compressed frames'),
    'skippable zstd frames': (
        lambda: many('zstd', struct.pack('<II', 0x184D2A50, 0)),
        'more than 64 compressed frames',
    ),
    'empty lz4 frames': (lambda: many('lz4', lz4.frame.compress(b'')), 'more than 64 compressed frames'),
    'too many topics': (
        lambda: mcap(schema(1) + b''.join(channel(n, f'/t{n}') for n in range(MAX_CHANNELS + 1))),
        'more than 4096 topics',
    ),
    'schemas of 70 MB': (
        lambda: mcap(b''.join(schema(n, definition=ZEROS[: 7 * 2**20]) for n in range(1, 11))),
        '67108864 bytes of their descriptions',
    ),
}
"""Files that ask for far more than they are, and why they are refused: not because memory ends."""

READ = """
from offradar_ros.recordings.bags.reader import Bag
"""
READ_ALL = """
with Bag(sys.argv[1]) as bag:
    print(sum(1 for _ in bag.messages()))
"""


@pytest.mark.parametrize('case', BOMBS)
def test_a_file_that_asks_for_too_much_is_refused(lone: Path, case: str) -> None:
    make, expected = BOMBS[case]
    lone.write_bytes(make())
    line = refusal(READ, READ_ALL, lone)
    assert line.startswith(f'{lone}: not a readable rosbag2 recording (')
    assert expected in line


def written(path: Path, mode: CompressionMode, storage: StoragePlugin, data: bytes) -> Path:
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(FIX, FIX_TYPE, typestore=TYPES)
        for log_ns in range(1, 4):
            writer.write(connection, log_ns, data)
    return path


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_compressed_messages_that_inflate_to_too_much_are_refused(tmp_path: Path, storage: StoragePlugin) -> None:
    bag = written(tmp_path / 'bag', CompressionMode.MESSAGE, storage, bytes(270 * 2**20))
    assert 'a message of more than' in refusal(READ, READ_ALL, bag)


@pytest.mark.parametrize('kind', [CHUNK, DATA_END, FOOTER])
def test_one_checksum_is_enough_for_what_it_covers(tmp_path: Path, kind: int) -> None:
    """Recorders write one or another of them."""
    bag = written(tmp_path / 'bag', CompressionMode.NONE, StoragePlugin.MCAP, b'\0\1\0\0payload')
    file = next(bag.glob('*.mcap'))
    write_checksums(file)
    with file.open('rb') as opened:
        records = {record.kind: record for record in top_records(opened)}
    content = bytearray(file.read_bytes())
    for other, place in ((CHUNK, 24), (DATA_END, 0), (FOOTER, 16)):
        at = records[other].body + place
        if other != kind:
            content[at : at + 4] = bytes(4)
        elif kind == DATA_END:
            content[at : at + 4] = struct.pack('<I', zlib.crc32(content[: records[kind].start]))
    file.write_bytes(content)
    assert len(content_of(bag)[-1]) == 3
    # A definition of the summary is compared with no other.
    content[records[SCHEMA].end - 1 if kind == FOOTER else content.index(b'payload')] ^= 1
    file.write_bytes(content)
    with pytest.raises(DataError, match='checksum'):
        Bag(bag)


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize('mode', [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed_bags_are_read(tmp_path: Path, storage: StoragePlugin, mode: CompressionMode) -> None:
    bag = written(tmp_path / 'bag', mode, storage, b'\0\1\0\0data')
    assert [m[3] for m in content_of(bag)[-1]] == [b'\0\1\0\0data'] * 3


def test_a_compressed_file_that_inflates_to_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = written(tmp_path / 'bag', CompressionMode.FILE, StoragePlugin.MCAP, bytes(2**20))
    monkeypatch.setattr('offradar_ros.recordings.bags.bag_check.MAX_FILE_BYTES', 2**20)
    with pytest.raises(DataError, match='more than 1048576 bytes when it is decompressed'):
        Bag(bag)


def test_a_compressed_file_of_empty_frames_is_refused_at_once(tmp_path: Path) -> None:
    bag = written(tmp_path / 'bag', CompressionMode.FILE, StoragePlugin.MCAP, b'\0\1\0\0data')
    (file,) = bag.glob('*.zstd')
    whole = file.read_bytes()
    file.write_bytes(whole + zstd.compress(b'') * 60)
    assert len(content_of(bag)[-1]) == 3
    for damaged, expected in (
        (whole + zstd.compress(b'') * (4 * 2**20 // 9), 'more than 64 compressed frames'),
        (whole[:-5], 'truncated zstd data'),
        (whole + b'rest', 'damaged zstd data'),
        (b'\x28\xb5\x2f\xfd', 'truncated zstd data'),
    ):
        file.write_bytes(damaged)
        with pytest.raises(DataError, match=rf'\({file.name}: its compression \({expected}.*\)\): copy it again$'):
            Bag(bag)


def test_what_follows_the_end_of_a_file_is_not_read_into_memory(lone: Path) -> None:
    with lone.open('wb') as file:
        file.write(mcap(SMALL))
        file.truncate(2**32)
        file.seek(0, 2)
        file.write(MAGIC)
    assert 'it does not end after its footer' in refusal(READ, READ_ALL, lone)


def test_names_of_a_file_stay_on_one_line(lone: Path) -> None:
    # The first in order, as it is the first that is told of.
    odd = '/a name\nof lines ' + 'x' * 10_000
    lone.write_bytes(mcap(schema(1) + channel(1, odd) + chunk(message(1, 101))))
    with pytest.raises(DataError) as refused:
        Bag(lone)
    assert len(str(refused.value).splitlines()) == 1
    written(lone.with_name('bag'), CompressionMode.NONE, StoragePlugin.MCAP, b'data')
    metadata = lone.with_name('bag') / 'metadata.yaml'
    tree = yaml.safe_load(metadata.read_text())
    tree['rosbag2_bagfile_information']['topics_with_message_count'][0]['topic_metadata']['name'] = odd
    metadata.write_text(yaml.safe_dump(tree))
    with pytest.raises(DataError) as refused:
        Bag(metadata.parent)
    assert 'messages of /a name of lines' in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1
    assert len(str(refused.value)) < 1000
    tree['rosbag2_bagfile_information']['version'] = odd
    metadata.write_text(yaml.safe_dump(tree))
    with pytest.raises(DataError, match=r'metadata\.yaml is damaged') as refused:
        Bag(metadata.parent)
    assert len(str(refused.value).splitlines()) == 1
    assert len(str(refused.value)) < 1000


@pytest.mark.parametrize(
    'bomb',
    [
        'a0: &a0 [x, x]\n' + ''.join(f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 9)}]\n' for n in range(1, 12)),
        '[' * 100_000,
        'x' * 5_000_000,
    ],
)
def test_metadata_that_asks_for_too_much_is_refused(bag: Path, bomb: str) -> None:
    (bag / 'metadata.yaml').write_text(bomb)
    line = refusal(READ, READ_ALL, bag)
    assert line.startswith(f'{bag}: not a readable rosbag2 recording (metadata.yaml ')


def sqlite(path: Path) -> Path:
    folder = written(path, CompressionMode.NONE, StoragePlugin.SQLITE3, b'\0\1\0\0' + b'data' * 2000)
    return next(folder.glob('*.db3'))


def test_pages_of_sqlite_that_are_not_in_order_are_refused(tmp_path: Path) -> None:
    file = sqlite(tmp_path / 'bag')
    content = bytearray(file.read_bytes())
    # The pages after the first hold tables, each with its kind in its first byte.
    for page in range(4096, len(content), 4096):
        content[page] ^= 0x40
    file.write_bytes(content)
    with pytest.raises(DataError, match='not a readable rosbag2 recording'):
        Bag(file)


def test_pages_of_sqlite_that_are_lost_are_noticed(tmp_path: Path) -> None:
    file = sqlite(tmp_path / 'bag')
    content = bytearray(file.read_bytes())
    # The number of free pages, in the header: no query sees it.
    content[39] ^= 4
    file.write_bytes(content)
    with pytest.raises(DataError, match='not a readable rosbag2 recording'):
        Bag(file)


CHANGES_SQL = {
    'a message of 1 GB': 'UPDATE messages SET data = zeroblob(300000000) WHERE id = 1',
    'a message of no topic': 'UPDATE messages SET topic_id = 9 WHERE id = 1',
    'a message without data': "UPDATE messages SET data = 'text' WHERE id = 1",
    'a time that is text': "UPDATE messages SET timestamp = 'yesterday' WHERE id = 1",
    'a view of endless rows': (
        'DROP TABLE messages; CREATE VIEW messages AS '
        'WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) '
        "SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n"
    ),
}


@pytest.mark.parametrize('change', CHANGES_SQL)
def test_rows_of_sqlite_that_cannot_be_are_refused(tmp_path: Path, change: str) -> None:
    file = sqlite(tmp_path / 'bag')
    connection = sqlite3.connect(file)
    connection.executescript(CHANGES_SQL[change])
    connection.commit()
    connection.close()
    assert 'not a readable rosbag2 recording' in refusal(READ, READ_ALL, file)


def test_names_of_sqlite_stay_on_one_line(tmp_path: Path) -> None:
    file = sqlite(tmp_path / 'bag')
    connection = sqlite3.connect(file)
    connection.execute('PRAGMA writable_schema = ON')
    odd = 'two\nlines ' + 'x' * 10_000
    connection.execute("UPDATE sqlite_master SET name = ?, sql = 'CREATE TABLE' WHERE name = 'topics'", (odd,))
    connection.commit()
    connection.close()
    with pytest.raises(DataError, match='malformed database schema') as refused:
        Bag(file)
    assert len(str(refused.value).splitlines()) == 1
    assert len(str(refused.value)) < 1000


def test_another_definition_of_a_type_is_a_contradiction(tmp_path: Path) -> None:
    """A reader would leave the messages out."""
    folder = written(tmp_path / 'bag', CompressionMode.NONE, StoragePlugin.SQLITE3, b'\0\1\0\0')
    tree = yaml.safe_load((folder / 'metadata.yaml').read_text())
    told = tree['rosbag2_bagfile_information']['topics_with_message_count'][0]['topic_metadata']
    assert told['type_description_hash']
    told['type_description_hash'] = f'RIHS01_{"0" * 64}'
    (folder / 'metadata.yaml').write_text(yaml.safe_dump(tree))
    with pytest.raises(DataError, match=f'says of {FIX} another type, format or QoS than its file'):
        Bag(folder)


def test_a_topic_without_messages_need_not_be_told_of(tmp_path: Path) -> None:
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kept, _ = (writer.add_connection(topic, FIX_TYPE, typestore=TYPES) for topic in (FIX, '/other'))
        writer.write(kept, 1, b'\0\1\0\0')
    tree = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    topics = tree['rosbag2_bagfile_information']['topics_with_message_count']
    topics[:] = [topic for topic in topics if topic['message_count']]
    (tmp_path / 'bag' / 'metadata.yaml').write_text(yaml.safe_dump(tree))
    with Bag(tmp_path / 'bag') as bag:
        assert bag.counts == {FIX: 1}


def test_quality_of_service_that_agrees_is_no_contradiction(tmp_path: Path) -> None:
    never = QosTime(0, 0)
    qos = Qos(
        QosHistory.KEEP_LAST,
        5,
        QosReliability.RELIABLE,
        QosDurability.VOLATILE,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        avoid_ros_namespace_conventions=False,
    )
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(FIX, FIX_TYPE, typestore=TYPES, offered_qos_profiles=[qos])
        writer.write(connection, 1, b'\0\1\0\0')
    assert len(content_of(tmp_path / 'bag')[-1]) == 1
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 1
