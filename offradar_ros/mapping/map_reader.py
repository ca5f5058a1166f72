"""Reads a map file without a change to the file or its folder."""

from __future__ import annotations

import contextlib
import json
import math
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import ConfigError, MapError, RefusedInput
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping import schema
from offradar_ros.mapping.place_columns import PlaceColumns, capacity_for, place_of
from offradar_ros.mapping.place_rows import CONTENT_COLUMNS, rows_to_table
from offradar_ros.mapping.stored_map import Before, StoredMap, StoredSession, revert
from offradar_ros.records import structure
from offradar_ros.types import PlaceTable

_BATCH = 1024
"""Rows read at once: few enough for the processor's cache."""

Content = TypeVar('Content')
SinkT = TypeVar('SinkT', bound='PlaceSink')


class PlaceSink(Protocol):
    """Receives places in ascending order of id, in batches."""

    def upsert(self, table: PlaceTable) -> None:
        """Store these places; RefusedInput if they are invalid."""


def read_map(path: Path) -> StoredMap:
    """Read the map at `path`; MapError says what is wrong with it. The file and its folder are not changed.

    A file without a write-ahead log is read as immutable, because SQLite's ordinary read-only mode would leave a log
    behind. If a writer starts meanwhile, the content is discarded and read again, concurrently with that writer.
    """
    return _consistently(path, _content)


def read_committed(path: Path, start: Callable[[int, int], SinkT]) -> tuple[str, SinkT]:
    """The map at `path` as of its last ended session, held in memory only once; MapError as `read_map`.

    `start(dimension, capacity)` makes the object that receives the places, in batches in ascending order of id; it is
    called again if a writer starts meanwhile. Returns the model's fingerprint ('' for a map without a model) and that
    object.
    """

    def stream(connection: sqlite3.Connection) -> tuple[str, SinkT]:
        model, _, _ = _head(connection)
        dimension = model.dimension if model else 0
        running = connection.execute("SELECT max(session_id) FROM sessions WHERE state = 'running'").fetchone()[0]
        before = {} if running is None else _contents_before(connection, dimension, running).get(running, {})
        sink = start(dimension, _capacity(connection, dimension))
        for rows in _batches(connection.execute(f'SELECT {CONTENT_COLUMNS} FROM places ORDER BY place_id')):
            table = rows_to_table(rows, dimension)
            inside = {i: before[i] for i in before.keys() & set(table.place_ids.tolist())} if before else {}
            try:
                sink.upsert(revert(table, inside) if inside else table)
            except RefusedInput as problem:
                raise MapError(f'{path}: {problem}') from problem
        return model.fingerprint if model else '', sink

    return _consistently(path, stream)


def _consistently(path: Path, read: Callable[[sqlite3.Connection], Content]) -> Content:
    if not path.is_file():
        raise MapError(f'{path}: no map file there')
    if not path.stat().st_size:
        raise MapError(f'{path}: an empty file, not a map: remove it to start a new map there')
    state = file_state(path)
    if state.log is None:
        try:
            content = _read(path, 'mode=ro&immutable=1', read)
        except MapError:
            if file_state(path) == state:
                raise
        else:
            if file_state(path) == state:
                return content
            # Memory may not be enough for two copies of the map.
            del content
    return _read(path, 'mode=ro', read)


class FileState(NamedTuple):
    """Device, inode, size and time of change of a map's files: two equal states mean that no one wrote in between.

    Attributes:
        file: state of the map file; None where it is missing or empty.
        log: the same of its write-ahead log.
    """

    file: tuple[int, ...] | None
    log: tuple[int, ...] | None


def file_state(path: Path) -> FileState:
    """State of the map at `path` now."""
    return FileState(_state(path), _state(path.with_name(path.name + '-wal')))


def _state(path: Path) -> tuple[int, ...] | None:
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns) if status.st_size else None


def _read(path: Path, mode: str, read: Callable[[sqlite3.Connection], Content]) -> Content:
    try:
        with contextlib.closing(sqlite3.connect(f'{path.resolve().as_uri()}?{mode}', uri=True)) as connection:
            connection.execute('BEGIN')
            _refuse_foreign(path, connection)
            content = read(connection)
            # The check reads backwards, which disks are slow at: now the pages are in memory, read forwards.
            _refuse_damaged(path, connection)
            return content
    except sqlite3.DatabaseError as error:
        if 'not a database' in str(error):
            raise MapError(f'{path}: not a map: expected a SQLite file written by offradar') from error
        raise MapError(f'{path}: the map is damaged or cannot be read ({error}); the file is not changed') from error
    except (ValueError, TypeError, KeyError, OverflowError, ConfigError, RefusedInput) as error:
        raise MapError(f'{path}: the map is damaged ({error}); the file is not changed') from error


def _refuse_foreign(path: Path, connection: sqlite3.Connection) -> None:
    application = int(connection.execute('PRAGMA application_id').fetchone()[0])
    version = int(connection.execute('PRAGMA user_version').fetchone()[0])
    if application != schema.APPLICATION_ID:
        raise MapError(f'{path}: a SQLite file, but not a map written by offradar')
    if version > schema.VERSION:
        raise MapError(
            f'{path}: written by a newer version of offradar (map format {version}, this one reads {schema.VERSION})'
        )


def _refuse_damaged(path: Path, connection: sqlite3.Connection) -> None:
    problem = str(connection.execute('PRAGMA quick_check(1)').fetchone()[0])
    if problem != 'ok':
        problem = problem.splitlines()[-1]
        raise MapError(f'{path}: the map is damaged ({problem}); the file is not changed')


def _content(connection: sqlite3.Connection) -> StoredMap:
    model, origin, next_place_id = _head(connection)
    dimension = model.dimension if model else 0
    columns, anchors_m = _places(connection, dimension)
    rows = connection.execute('SELECT session_id, name, stamp_ns, state, report FROM sessions ORDER BY session_id')
    return StoredMap(
        model=model,
        origin=origin,
        next_place_id=next_place_id,
        columns=columns,
        anchors_m=anchors_m,
        sessions=tuple(
            StoredSession(session_id, name, stamp_ns, state, json.loads(report))
            for session_id, name, stamp_ns, state, report in rows
        ),
        before=_contents_before(connection, dimension),
    )


def _head(connection: sqlite3.Connection) -> tuple[ModelInfo | None, GeoPoint | None, int]:
    """Model, origin and next place id."""
    meta = {key: json.loads(value) for key, value in connection.execute('SELECT key, value FROM meta')}
    model = structure(ModelInfo, meta['model']) if meta['model'] else None
    origin = structure(GeoPoint, meta['origin']) if meta['origin'] else None
    return model, origin, int(meta['next_place_id'])


def _capacity(connection: sqlite3.Connection, dimension: int) -> int:
    """Capacity for the places of the map and more, estimated by ids and file size: COUNT(*) would read all of it."""
    newest = connection.execute('SELECT max(place_id) FROM places').fetchone()[0]
    size = (connection.execute(f'PRAGMA {name}').fetchone()[0] for name in ('page_count', 'page_size'))
    return capacity_for(min((newest or 0) + 1, math.prod(size) // max(4 * dimension, 1)))


def _places(connection: sqlite3.Connection, dimension: int) -> tuple[PlaceColumns, NDArray[np.float64]]:
    columns, anchors = PlaceColumns(dimension, _capacity(connection, dimension)), [np.empty((0, 2))]
    cursor = connection.execute(f'SELECT {CONTENT_COLUMNS}, anchor_x_m, anchor_y_m FROM places ORDER BY place_id')
    for batch in _batches(cursor):
        columns.upsert(rows_to_table(batch, dimension))
        anchors.append(np.array([row[9:] for row in batch], np.float64))
    anchors_m = np.concatenate(anchors)
    if not np.isfinite(anchors_m).all():
        raise ValueError('a place has no finite position')
    return columns, anchors_m


def _contents_before(
    connection: sqlite3.Connection, dimension: int, session_id: int | None = None
) -> dict[int, Before]:
    """By session, what its places held before it; only for `session_id` where that is given."""
    before: dict[int, Before] = {}
    cursor = connection.execute(
        f'SELECT {CONTENT_COLUMNS}, by_session, existed FROM undo WHERE by_session = coalesce(?, by_session) '
        'ORDER BY by_session, place_id',
        (session_id,),
    )
    for batch in _batches(cursor):
        for row in batch:
            before.setdefault(row[9], {})[row[0]] = None
        kept = [row for row in batch if row[10]]
        table = rows_to_table(kept, dimension)
        for i, row in enumerate(kept):
            before[row[9]][row[0]] = place_of(table, i)
    return before


def _batches(cursor: sqlite3.Cursor) -> Iterator[list[Any]]:
    while batch := cursor.fetchmany(_BATCH):
        yield batch
