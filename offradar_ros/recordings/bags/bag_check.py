"""Files of a bag are checked before they are read: that they are undamaged, within bounds, and as metadata.yaml says.

Not seen is damage of messages without checksums: in MCAP files of writers that leave them out, and in SQLite files.
"""

from __future__ import annotations

import functools
import shlex
import tempfile
from pathlib import Path

from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader

from offradar_ros.errors import DataError
from offradar_ros.recordings.bags.bag_facts import BagFacts, joined
from offradar_ros.recordings.bags.inflate import inflated_pieces
from offradar_ros.recordings.bags.mcap_check import check_mcap
from offradar_ros.recordings.bags.mcap_records import Damage
from offradar_ros.recordings.bags.sqlite_check import check_sqlite
from offradar_ros.recordings.bags.storage import Metadata, read_metadata, state_of, written_again

MAX_FILE_BYTES = 64 * 1024**3
"""Largest content of a file that was compressed as a whole."""
_LONGEST = 300
"""Most characters of a reason: names within a file may be of any length."""


def check_bag_files(path: Path) -> BagFacts:
    """What a bag holds, a folder or a file that rosbags opens.

    Files that did not change are checked once in a process. DataError, with the way out, for a file that is damaged or
    beyond bounds, and where metadata.yaml names other topics or numbers of messages than the files hold.
    """
    try:
        if not path.is_dir():
            return _facts(path, path, '')
        metadata = read_metadata(path)
        facts = joined(_facts(path, file, metadata.compression) for file in metadata.files)
    except OSError as error:
        raise DataError(f'{error.filename or path}: cannot be read ({error.strerror})') from error
    _require_agreement(path, metadata, facts)
    return facts


def read_in_order(path: Path, reader: Reader) -> None:
    """Make an open reader of a folder read its files as they follow each other, in whatever order they are listed."""
    if isinstance(reader.storage, DirectoryReader):
        metadata = read_metadata(path)
        starts_ns = [_facts(path, file, metadata.compression).start_ns for file in metadata.files]
        ordered = sorted(zip(starts_ns, reader.storage.storages, strict=True), key=lambda item: item[0])
        reader.storage.storages[:] = [storage for _, storage in ordered]


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
                what = f'says of {held.topic} another type, format or QoS than its file'
                raise _disagreement(path, what, read_metadata(path).compression)


def _facts(path: Path, file: Path, compression: str) -> BagFacts:
    try:
        return _checked(file, state_of(file), compression)
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
    if compression == 'file':
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


def _require_agreement(path: Path, metadata: Metadata, facts: BagFacts) -> None:
    for topic in sorted(metadata.counts.keys() | facts.counts.keys()):
        said, found = metadata.counts[topic], facts.counts[topic]
        if said != found:
            what = f'says {said} messages of {topic[0]} ({topic[1]}), its files hold {found}'
            raise _disagreement(path, what, metadata.compression)


def _disagreement(path: Path, what: str, compression: str) -> DataError:
    shown = ' '.join(what.split())[:_LONGEST]
    return DataError(
        f'{path}: metadata.yaml is damaged, or of other files: it {shown}: {written_again(path, compression)}'
    )
