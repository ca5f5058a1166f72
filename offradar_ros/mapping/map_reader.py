"""Reads a map file without a change to it or to the log beside it."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import sqlite3
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from offradar_ros.bounded_input import MAX_TEXT_BYTES
from offradar_ros.errors import ConfigError, MapError, RefusedInput
from offradar_ros.mapping import schema
from offradar_ros.mapping.map_rows import MapRows, require_undoable
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.mapping.seal import Seal
from offradar_ros.mapping.stored_map import StoredMap, revert
from offradar_ros.types import PlaceTable

ALONE = 'mode=ro&immutable=1'
"""How SQLite opens the file without the log beside it."""
WITH_LOG = 'mode=ro'
BUSY_TIMEOUT_S = 0.5
"""Longest wait for a lock of another process; scans keep arriving meanwhile."""

Content = TypeVar('Content')
SinkT = TypeVar('SinkT', bound='PlaceSink')


class PlaceSink(Protocol):
    """Receives places in ascending order of id, in batches."""

    def upsert(self, table: PlaceTable) -> None:
        """Store these places; RefusedInput if they are invalid."""


def read_map(path: Path) -> StoredMap:
    """Read the map at `path`; MapError says what is wrong with it. The file and the log beside it are not changed.

    Nor is their folder, except that SQLite makes the index of a log (``-shm``) where that is missing. A file without a
    write-ahead log is read as immutable, because SQLite's ordinary read-only mode would leave a log behind. If a writer
    starts meanwhile, the content is discarded and read again, concurrently with that writer. A log that does not belong
    to the file, as is left where another map is copied over one, is not read.
    """
    stored, is_log_foreign = consistently(path, _content)
    return dataclasses.replace(stored, is_log_foreign=is_log_foreign)


def read_committed(path: Path, start: Callable[[int, int], SinkT]) -> tuple[str, SinkT]:
    """The map at `path` as of its last ended session, held in memory only once; MapError as `read_map`.

    `start(dimension, capacity)` makes the object that receives the places, in batches in ascending order of id; it is
    called again if a writer starts meanwhile. Returns the model's fingerprint ('' for a map without a model) and that
    object. Signatures are counted, not read.
    """

    def stream(rows: MapRows) -> tuple[str, SinkT]:
        running = rows.running_session_id
        rows.check_signature_sum()
        # Without a running session nothing is selected, but every row is checked.
        before = rows.before(-1 if running is None else running).get(running or -1, {})
        sink = start(rows.dimension, rows.capacity())
        for table, _ in rows.places():
            inside = {i: before[i] for i in before.keys() & set(table.place_ids.tolist())} if before else {}
            sink.upsert(revert(table, inside) if inside else table)
        return rows.model.fingerprint if rows.model else '', sink

    return consistently(path, stream)[0]


def check_map(path: Path, *, with_log: bool = True) -> tuple[Seal | None, bool]:
    """Read every row of the map at `path` and keep none. MapError as `read_map`.

    Returns its seal, None in version 1, and whether there was a log beside it that was read.
    """

    def check(rows: MapRows) -> Seal | None:
        rows.before(-1)
        for _ in itertools.chain(rows.places(), rows.signatures()):
            pass
        return rows.seal

    require_file(path)
    is_with_log = with_log and file_state(path).log is not None
    return _read(path, WITH_LOG if is_with_log else ALONE, check), is_with_log


def _content(rows: MapRows) -> StoredMap:
    columns, anchors = PlaceColumns(rows.dimension, rows.capacity()), [np.empty((0, 2))]
    for table, anchors_m in rows.places():
        columns.upsert(table)
        anchors.append(anchors_m)
    before = rows.before()
    require_undoable(before, columns.table.place_ids)
    return StoredMap(
        model=rows.model,
        origin=rows.origin,
        next_place_id=rows.next_place_id,
        columns=columns,
        anchors_m=np.concatenate(anchors),
        sessions=rows.sessions,
        before=before,
        signatures=dict(rows.signatures()),
        version=rows.version,
        seal=rows.seal,
    )


def consistently(path: Path, read: Callable[[MapRows], Content]) -> tuple[Content, bool]:
    """What `read` returns for the map at `path`, all of one transaction, and whether a foreign log lies beside it.

    `read` may be called again. MapError says what is wrong with the map.
    """
    require_file(path)
    state = file_state(path)
    if state.log is None:
        try:
            content = _read(path, ALONE, read)
        except MapError:
            if file_state(path) == state:
                raise
        else:
            if file_state(path) == state:
                return content, False
            # Memory may not be enough for two copies of the map.
            del content
    try:
        return _read(path, WITH_LOG, read), False
    except DamagedMapError as problem:
        if file_state(path).log is None:
            return _read(path, ALONE, read), False
        # A sound map beside a log with which it is none: the log is of another file, or of another state of this one.
        try:
            return _read(path, ALONE, read), True
        except MapError:
            raise problem from None


class FileState(NamedTuple):
    """Device, inode, size and time of change of a map's files: two equal states mean that no one wrote in between.

    Attributes:
        file: state of the map file; None where it is missing or empty.
        log: the same of its write-ahead log.
    """

    file: tuple[int, ...] | None
    log: tuple[int, ...] | None


def file_state(path: Path) -> FileState:
    """State of the map at `path` now; MapError where its folder cannot be read."""
    return FileState(_state(path), _state(log_of(path)))


def log_of(path: Path) -> Path:
    """Where SQLite keeps the write-ahead log of a file."""
    return path.with_name(path.name + '-wal')


def rollback_log_of(path: Path) -> Path:
    """Where SQLite keeps the log of a file that is not in WAL mode, which no map is."""
    return path.with_name(path.name + '-journal')


def open_sqlite(path: Path, mode: str) -> sqlite3.Connection:
    """A connection that does nothing that a file could ask for; `mode` is part of a URI."""
    connection = sqlite3.connect(
        f'{path.resolve().as_uri()}?{mode}',
        uri=True,
        isolation_level=None,
        check_same_thread=False,
        timeout=BUSY_TIMEOUT_S,
    )
    if sys.version_info >= (3, 11):
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_TEXT_BYTES)
    # Damaged text has a wrong digest; an error of SQLite's would not say that it is the content.
    connection.text_factory = _decoded
    connection.execute('PRAGMA trusted_schema = OFF')
    connection.execute('PRAGMA cell_size_check = ON')
    return connection


def _decoded(text: bytes) -> str:
    return text.decode('utf-8', 'surrogateescape')


def status_of(path: Path) -> os.stat_result | None:
    """Status of the file at `path`, None where there is none; MapError where that cannot be seen."""
    try:
        return path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        why = getattr(error, 'strerror', None) or error
        raise MapError(f'{path}: cannot be read ({why}): check the path, and the permissions of its folder') from error


def _state(path: Path) -> tuple[int, ...] | None:
    status = status_of(path)
    return (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns) if status and status.st_size else None


def require_file(path: Path) -> None:
    """MapError unless there is a file at `path` that may be a map."""
    status = status_of(path)
    if status is None:
        raise MapError(f'{path}: no map file there')
    if not stat.S_ISREG(status.st_mode):
        raise MapError(f'{path}: not a file: expected the path of a map file')
    if not status.st_size:
        raise MapError(f'{path}: an empty file, not a map: remove it to start a new map there')


class DamagedMapError(MapError):
    """What the file and the log beside it hold together is no map."""


def _read(path: Path, mode: str, read: Callable[[MapRows], Content]) -> Content:
    with explained(path), contextlib.closing(open_sqlite(path, mode)) as connection:
        content = read(begin_reading(path, connection, mode))
        # The check reads backwards, which disks are slow at: now the pages are in memory, read forwards.
        _refuse_damaged(connection)
        return content


def begin_reading(path: Path, connection: sqlite3.Connection, mode: str) -> MapRows:
    """The rows of the map at `path`, in a transaction that begins here; `mode` is that of the connection.

    Raises what `explained` explains, also for a log that does not belong to the file.
    """
    connection.execute('PRAGMA query_only = ON')
    connection.execute('BEGIN')
    rows = MapRows(connection, _require_map(path, connection))
    if mode == WITH_LOG:
        _require_own_log(path, rows)
    return rows


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
    """Whatever goes wrong while the map at `path` is read is a MapError of one line."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise MapError(f'{path}: the map cannot be read ({error}); the file is not changed') from error
    except sqlite3.DatabaseError as error:
        if 'not a database' in str(error):
            raise DamagedMapError(f'{path}: not a map: expected a SQLite file written by offradar') from error
        raise DamagedMapError(f'{path}: the map is damaged ({_line(error)}); the file is not changed') from error
    except (ValueError, TypeError, KeyError, OverflowError, ConfigError, RefusedInput) as error:
        raise DamagedMapError(f'{path}: the map is damaged ({_line(error)}); the file is not changed') from error
    except MemoryError as error:
        raise MapError(f'{path}: the map is too large for the memory of this computer') from error
    except OSError as error:
        raise MapError(f'{path}: the map cannot be read ({error.strerror})') from error


def _line(error: Exception) -> str:
    """An error in one line that can be printed, whatever a damaged file holds."""
    return str(error).encode('ascii', 'backslashreplace').decode().replace('\n', ' ')


def _require_map(path: Path, connection: sqlite3.Connection) -> int:
    """The version of the map; MapError for another file."""
    application = int(connection.execute('PRAGMA application_id').fetchone()[0])
    version = int(connection.execute('PRAGMA user_version').fetchone()[0])
    if application != schema.APPLICATION_ID:
        raise DamagedMapError(f'{path}: a SQLite file, but not a map written by offradar')
    if version > schema.VERSION:
        raise DamagedMapError(
            f'{path}: written by a newer version of offradar (map format {version}, this one reads {schema.VERSION})'
        )
    if version < 1 or schema.objects(connection) != schema.expected_objects(version):
        raise DamagedMapError(
            f'{path}: the map is damaged (its tables are not those of a map); the file is not changed'
        )
    return version


def _require_own_log(path: Path, with_log: MapRows) -> None:
    """ValueError if the log that was read does not continue what the file holds without it.

    The open transaction keeps a writer from moving newer content into the file meanwhile.
    """
    try:
        with contextlib.closing(open_sqlite(path, ALONE)) as other:
            alone = MapRows(other, _require_map(path, other))
    except (sqlite3.Error, ValueError, TypeError, KeyError, ConfigError, RefusedInput, MapError):
        # A process that was killed while it moved the log into the file: the log is needed.
        return
    if with_log.seal and alone.seal:
        if not with_log.seal.follows(alone.seal):
            raise ValueError('the log beside it belongs to another map, or to another state of this one')
    elif (with_log.version, with_log.created) != (alone.version, alone.created):
        raise ValueError('the log beside it belongs to another map')


def _refuse_damaged(connection: sqlite3.Connection) -> None:
    problem = str(connection.execute('PRAGMA quick_check(1)').fetchone()[0])
    if problem != 'ok':
        raise ValueError(problem.splitlines()[-1])
