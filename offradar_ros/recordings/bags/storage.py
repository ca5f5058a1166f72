"""The files of a recording: which of them rosbags reads, and for any other what it is and what makes it readable."""

from __future__ import annotations

import functools
import shlex
import struct
from collections import Counter
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import yaml

from offradar_ros.bounded_input import parse_yaml, read_text
from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.bag_facts import Topic

METADATA = 'metadata.yaml'
STORAGES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
"""Suffixes of storage files, and what rosbag2 calls their storage."""

_NEWEST_METADATA = 9
"""Newest version of metadata.yaml that rosbags reads."""
_MCAP, _SQLITE, _ROS1, _ZSTD = b'\x89MCAP0\r\n', b'SQLite format 3\0', b'#ROSBAG V', b'\x28\xb5\x2f\xfd'
_ARCHIVES = {b'\x1f\x8b': 'gzip', b'PK\x03\x04': 'zip', b'7z\xbc\xaf': '7z', b'BZh': 'bzip2', b'\xfd7zXZ': 'xz'}
_COMPRESSED = {'.zstd', '.zst'}
_LONGEST = 300
"""Most characters of a reason: what a file holds may be of any length."""


class Metadata(NamedTuple):
    """What metadata.yaml says.

    Attributes:
        version: of its format.
        storage: what rosbag2 calls the storage; may be empty.
        files: of the bag, in the folder.
        compression: ``file``, ``message`` or empty.
        counts: messages of each topic that has any.
    """

    version: int
    storage: str
    files: tuple[Path, ...]
    compression: str
    counts: Counter[Topic]


def readable_paths(path: Path) -> tuple[Path, ...]:
    """What `rosbags.rosbag2.Reader` can open of a recording, to be read one after the other.

    The folder itself where its metadata.yaml fits; its storage files where metadata.yaml is of another version or does
    not say what they are. DataError, with the command that makes it readable, for anything else.
    """
    try:
        if not path.exists():
            raise DataError(f'{path}: no such bag')
        if not path.is_dir():
            _require_readable(path, path)
            return (path,)
        return _of_folder(path)
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from error


def holds_storage(folder: Path) -> bool:
    """Whether a file in the folder has the suffix of a recording, be it of ROS 2, compressed or of ROS 1."""
    return bool(_storage_files(folder)) or any(not file.name.startswith('.') for file in folder.glob('*.bag'))


def is_storage(file: Path) -> bool:
    """Whether a file is a recording, by its suffix or by its first bytes."""
    if file.suffix in (*STORAGES, '.bag') or _suffix(file) in STORAGES:
        return True
    return file.is_file() and _start(file).startswith((_MCAP, _SQLITE, _ROS1))


def unlisted_files(path: Path) -> list[str]:
    """Names of recordings in a bag's folder that its metadata does not name, so that nobody reads them."""
    if not (path / METADATA).is_file():
        return []
    try:
        listed = {file.name for file in read_metadata(path).files}
    except DataError:
        return []
    return [file.name for file in _storage_files(path) if file.name not in listed]


def unreadable(path: Path, reason: str) -> DataError:
    """The error for a recording that cannot be read."""
    return DataError(f'{path}: not a readable rosbag2 recording ({reason})')


def read_metadata(folder: Path) -> Metadata:
    """What metadata.yaml of a folder says; DataError, with the way out, where it is damaged."""
    file = folder / METADATA
    try:
        return _metadata(file, state_of(file))
    except OSError as error:
        raise unreadable(folder, f'{METADATA} cannot be read: {error.strerror}') from None
    except (yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = ' '.join(f'{type(error).__name__}: {error}'.split())[:_LONGEST]
        raise unreadable(folder, f'{METADATA} is damaged or empty ({reason}): {written_again(folder)}') from None


def state_of(file: Path) -> tuple[int, int, int]:
    """What changes when a file does."""
    found = file.stat()
    return found.st_ino, found.st_size, found.st_mtime_ns


def written_again(folder: Path, compression: str = '') -> str:
    """What writes the metadata of a folder again, as a clause."""
    if compression == 'message':
        return 'copy it again, ros2 bag reindex does not read messages that are compressed one by one'
    return f'{_reindex(folder, _storage_files(folder))} writes it again'


def _of_folder(folder: Path) -> tuple[Path, ...]:
    if not (folder / METADATA).exists():
        raise _without_metadata(folder)
    metadata = read_metadata(folder)
    missing = [file.name for file in metadata.files if not file.exists()]
    if missing:
        raise unreadable(
            folder,
            f'{METADATA} names {", ".join(missing[:3])}, which is not there: put it back under that name, or '
            f'{_reindex(folder, _storage_files(folder))} leaves it out',
        )
    # Files that were compressed as a whole show what they are when they are decompressed.
    if metadata.compression != 'file':
        for file in metadata.files:
            _require_readable(file, folder)
    fits = all(STORAGES.get(_suffix(file)) == metadata.storage for file in metadata.files)
    if metadata.version <= _NEWEST_METADATA and metadata.storage in STORAGES.values() and fits:
        return (folder,)
    if metadata.compression:
        raise unreadable(
            folder,
            f'its {METADATA} is of version {metadata.version} with storage {metadata.storage!r} and compression: '
            'ros2 bag convert writes a bag without compression',
        )
    return metadata.files


@functools.lru_cache(maxsize=64)
def _metadata(file: Path, _: tuple[int, int, int]) -> Metadata:
    tree: Any = parse_yaml(read_text(file))
    information = tree['rosbag2_bagfile_information']
    # Old versions have the path from where it was recorded.
    files = tuple(file.with_name(PurePosixPath(str(name)).name) for name in information['relative_file_paths'])
    if len(set(files)) < len(files):
        raise ValueError('names a file twice')
    compression = str(information.get('compression_mode') or '').lower()
    counts: Counter[Topic] = Counter()
    for topic in information['topics_with_message_count']:
        told = topic['topic_metadata']
        counts[str(told['name']), str(told['type'])] += int(topic['message_count'])
    return Metadata(
        version=int(information['version']),
        storage=str(information.get('storage_identifier') or ''),
        files=files,
        compression='' if compression == 'none' else compression,
        counts=+counts,
    )


def _without_metadata(folder: Path) -> DataError:
    files = _storage_files(folder)
    if not files:
        old = sorted(folder.glob('*.bag'))
        if old:
            return DataError(f'{folder}: holds {old[0].name}, {_ros1(old[0])}')
        return DataError(f'{folder}: no {METADATA} and no .mcap or .db3 file: not a rosbag2 folder')
    try:
        for file in files:
            _require_readable(file, file)
    except DataError as error:
        return DataError(f'{folder}: no {METADATA}, the recording was cut off: {error}')
    whole = f', or read {shlex.quote(str(files[0]))} by itself' if len(files) == 1 else ''
    return DataError(
        f'{folder}: no {METADATA}, the recording was cut off before its end: {_reindex(folder, files)} writes it{whole}'
    )


def _storage_files(folder: Path) -> list[Path]:
    # Hidden ones are not recordings: macOS puts a ._NAME beside each file that it copies.
    return sorted(file for file in folder.iterdir() if _suffix(file) in STORAGES and not file.name.startswith('.'))


def _suffix(file: Path) -> str:
    """The suffix, under that of a compression if it has one."""
    return Path(file.stem).suffix if file.suffix in _COMPRESSED else file.suffix


def _reindex(folder: Path, files: list[Path]) -> str:
    storage = STORAGES[_suffix(files[0])] if files else 'mcap'
    where = shlex.quote(str(folder))
    inflated = ''.join(
        f'zstd -d --rm {where}/*{suffix} && ' for suffix in {file.suffix for file in files} & _COMPRESSED
    )
    return f'{inflated}ros2 bag reindex -s {storage} {where}'


def _ros1(file: Path) -> str:
    new = shlex.quote(str(file.with_suffix('')))
    return (
        f'a recording of ROS 1: rosbags-convert --src {shlex.quote(str(file))} --dst {new} makes a rosbag2 folder of it'
    )


def _require_readable(file: Path, recording: Path) -> None:
    """DataError where a storage file is not what its suffix says, or has no end; `recording` is named."""
    if not file.is_file():
        raise unreadable(recording, f'{file.name} is not a regular file')
    start, command = _start(file), shlex.quote(str(file))
    problem = ''
    if not start:
        problem = f'{file.name} is empty: it was cut off before the first message, and nothing of it can be saved'
    elif start.startswith(_ROS1):
        raise DataError(f'{recording}: {"" if recording == file else f"{file.name} is "}{_ros1(file)}')
    elif start.startswith(_ZSTD):
        problem = (
            f'{file.name} is compressed as a whole: give the folder with its {METADATA}, or zstd -d {command} '
            'decompresses it'
        )
    elif start.startswith(tuple(_ARCHIVES)):
        kind = next(name for magic, name in _ARCHIVES.items() if start.startswith(magic))
        problem = f'{file.name} is a {kind} archive: unpack it first'
    elif start.startswith(_MCAP):
        problem = _mcap_problem(file, start)
    elif start.startswith(_SQLITE):
        problem = _sqlite_problem(file, start)
    else:
        problem = f'{file.name} holds neither MCAP nor SQLite: it is another file, or its beginning is damaged'
    if problem:
        raise unreadable(recording, problem)


def _mcap_problem(file: Path, start: bytes) -> str:
    if file.suffix != '.mcap':
        return f'{file.name} is an MCAP file: rename it to {file.stem}.mcap'
    with file.open('rb') as stream:
        size = stream.seek(0, 2)
        stream.seek(max(size - len(_MCAP), 0))
        complete = size > len(_MCAP) and stream.read() == _MCAP
    if not complete:
        command, saved = shlex.quote(str(file)), shlex.quote(str(file.with_name(f'{file.stem}_recovered.mcap')))
        return f'{file.name} was cut off, it has no end: mcap recover {command} -o {saved} saves what is before the cut'
    # The header, which follows: an operation code, its length, and the length of the profile.
    (length,) = struct.unpack_from('<I', start.ljust(21, b'\0'), 17)
    profile = start[21 : 21 + length]
    if profile == b'ros1':
        return f'{file.name} holds messages of ROS 1: rosbags-convert makes a rosbag2 folder of the .bag file'
    return ''


def _sqlite_problem(file: Path, start: bytes) -> str:
    if file.suffix != '.db3':
        return f'{file.name} is an SQLite file: rename it to {file.stem}.db3 if it is a recording'
    command = shlex.quote(str(file))
    for suffix in ('-wal', '-journal'):
        beside = file.with_name(file.name + suffix)
        if beside.exists() and beside.stat().st_size:
            return (
                f'{beside.name} beside it holds a part of it, the recording was cut off: '
                f"sqlite3 {command} 'PRAGMA journal_mode=DELETE' joins them"
            )
    # Size of a page, where 1 stands for 65536, and number of pages (the SQLite file format, section 1.3).
    page, pages = struct.unpack_from('>H10xI', start.ljust(32, b'\0'), 16)
    if file.stat().st_size < (65536 if page == 1 else page) * pages:
        return (
            f'{file.name} was cut off: sqlite3 {command} .recover | sqlite3 recovered.db3 saves what is before the cut'
        )
    return ''


def _start(file: Path) -> bytes:
    if not file.is_file():
        return b''
    with file.open('rb') as stream:
        return stream.read(64)
