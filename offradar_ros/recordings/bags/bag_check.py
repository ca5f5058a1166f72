"""Files of a bag are checked before they are read: that they are undamaged, within bounds, and as metadata.yaml says.

Not seen is damage of messages without checksums: in MCAP files of writers that leave them out, and in SQLite files.
"""

from __future__ import annotations

import functools
import shlex
import tempfile
from collections import Counter
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import yaml
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader

from offradar_ros.bounded_input import parse_yaml, read_text
from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.bag_facts import BagFacts, Topic, joined
from offradar_ros.recordings.bags.inflate import inflated_pieces
from offradar_ros.recordings.bags.mcap_check import check_mcap
from offradar_ros.recordings.bags.mcap_records import Damage
from offradar_ros.recordings.bags.sqlite_check import check_sqlite

MAX_FILE_BYTES = 64 * 1024**3
"""Largest content of a file that was compressed as a whole."""
_ZSTD = '.zstd'
_LONGEST = 300
"""Most characters of a reason: names within a file may be of any length."""


class _Metadata(NamedTuple):
    """What metadata.yaml says: its files, how they are compressed, and messages of each topic that has any."""

    files: tuple[Path, ...]
    compression: str
    counts: Counter[Topic]


def check_bag_files(path: Path) -> BagFacts:
    """What a bag holds, a folder or a file that rosbags opens.

    Files that did not change are checked once in a process. DataError, with the way out, for a file that is damaged or
    beyond bounds, and where metadata.yaml names other topics or numbers of messages than the files hold.
    """
    try:
        if not path.is_dir():
            return _facts(path, path, '')
        metadata = _metadata(path / 'metadata.yaml', _state(path / 'metadata.yaml'))
        facts = joined(_facts(path, file, metadata.compression) for file in metadata.files)
    except OSError as error:
        raise DataError(f'{error.filename or path}: cannot be read ({error.strerror})') from error
    _require_agreement(path, metadata, facts)
    return facts


def require_all_read(path: Path, reader: Reader) -> None:
    """DataError if an open reader would leave out messages: it matches topics of files with those of metadata.yaml."""
    if not isinstance(reader.storage, DirectoryReader):
        return
    for storage in reader.storage.storages:
        for held in storage.connections:
            if held.msgcount and not any(
                (said.topic, said.msgtype, said.ext) == (held.topic, held.msgtype, held.ext)
                and (not said.digest or not held.digest or said.digest == held.digest)
                for said in reader.storage.connections
            ):
                raise _disagreement(path, f'says of {held.topic} another type, format or QoS than its file')


def _state(file: Path) -> tuple[int, int, int]:
    """What changes when a file does."""
    found = file.stat()
    return found.st_ino, found.st_size, found.st_mtime_ns


def _facts(path: Path, file: Path, compression: str) -> BagFacts:
    try:
        return _checked(file, _state(file), compression)
    except Damage as damage:
        where = '' if file == path else f'{file.name}: '
        reason = ' '.join(str(damage).split())[:_LONGEST]
        saved = f', or save what is whole: mcap recover {shlex.quote(str(file))} -o NEW.mcap'
        raise DataError(
            f'{path}: not a readable rosbag2 recording ({where}{reason}): copy it again'
            f'{saved if file.suffix == ".mcap" else ""}'
        ) from None


# Without a bound: a bag of more files than that would be checked again for each scan.
@functools.cache
def _checked(file: Path, _: tuple[int, int, int], compression: str) -> BagFacts:
    if file.suffix == _ZSTD and compression == 'file':
        with tempfile.TemporaryDirectory() as folder:
            inflated = Path(folder) / file.stem
            _inflate(file, inflated)
            return _check(inflated, '')
    return _check(file, compression)


def _check(file: Path, compression: str) -> BagFacts:
    check = check_sqlite if file.suffix == '.db3' else check_mcap
    return check(file, compression == 'message')


def _inflate(file: Path, out: Path) -> None:
    """Decompress a file that was compressed as a whole; Damage if it is larger than any recording."""
    size = 0
    try:
        with file.open('rb') as compressed, out.open('wb') as target:
            for piece in inflated_pieces(compressed):
                size += len(piece)
                if size > MAX_FILE_BYTES:
                    raise ValueError(f'more than {MAX_FILE_BYTES} bytes when it is decompressed')
                target.write(piece)
    except ValueError as error:
        raise Damage(f'its compression ({error})') from error


@functools.lru_cache(maxsize=64)
def _metadata(file: Path, _: tuple[int, int, int]) -> _Metadata:
    try:
        tree: Any = parse_yaml(read_text(file))['rosbag2_bagfile_information']
        # Old versions have the path from where it was recorded.
        files = tuple(file.with_name(PurePath(str(name)).name) for name in tree['relative_file_paths'])
        mode = str(tree.get('compression_mode') or '').lower()
        counts: Counter[Topic] = Counter()
        for topic in tree['topics_with_message_count']:
            told = topic['topic_metadata']
            counts[str(told['name']), str(told['type'])] += int(topic['message_count'])
    except (yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = ' '.join(str(error).split())
        raise DataError(
            f'{file}: damaged, or not that of a bag ({type(error).__name__}: {reason[:_LONGEST]}): '
            f'ros2 bag reindex {shlex.quote(str(file.parent))} writes it again'
        ) from None
    if len(set(files)) < len(files):
        raise _disagreement(file.parent, 'names a file twice')
    return _Metadata(files, mode, +counts)


def _require_agreement(path: Path, metadata: _Metadata, facts: BagFacts) -> None:
    for topic in sorted(metadata.counts.keys() | facts.counts.keys()):
        said, found = metadata.counts[topic], facts.counts[topic]
        if said != found:
            raise _disagreement(path, f'says {said} messages of {topic[0]} ({topic[1]}), its files hold {found}')


def _disagreement(path: Path, what: str) -> DataError:
    shown = ' '.join(what.split())[:_LONGEST]
    return DataError(
        f'{path}: metadata.yaml is damaged, or of other files: it {shown}: '
        f'ros2 bag reindex {shlex.quote(str(path))} writes it again'
    )
