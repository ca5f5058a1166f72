"""The map on disk: committed sessions are safe against a killed process and a power cut."""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping import schema
from offradar_ros.mapping.map_reader import read_map
from offradar_ros.mapping.place_rows import table_to_rows
from offradar_ros.mapping.stored_map import Before, StoredMap, StoredSession
from offradar_ros.mapping.writer_lock import WriterLock
from offradar_ros.records import unstructure
from offradar_ros.types import PlaceTable

_NOTHING = (None,) * 8

BUSY_TIMEOUT_S = 0.5
"""Longest wait for a lock of another process; scans keep arriving meanwhile."""


class MapStore:
    """The only writer of a map file. Each method that changes the file is one transaction.

    Made by `open`. Several threads may use it, one call at a time.
    """

    def __init__(self, path: Path, lock: WriterLock) -> None:
        self.path = path
        self._lock = lock
        self._connection: sqlite3.Connection | None = None

    @classmethod
    def open(cls, path: Path) -> tuple[MapStore, StoredMap]:
        """Open the map at `path`, or create one there, and read it.

        Raises MapError for a folder that is missing or not writable, a map that another process writes, and a file
        that is not a map, damaged or of a newer version; such a file is not changed. An existing map is not written
        before the first change.
        """
        if path.is_dir():
            raise MapError(f'{path}: a folder: expected the path of a map file')
        # One lock for each file, whatever its name: two writers through a link would overwrite each other.
        path = path.resolve()
        lock = WriterLock(path)
        try:
            if not path.exists():
                _create(path)
            return cls(path, lock), read_map(path)
        except BaseException:
            lock.release()
            raise

    @staticmethod
    def open_read_only(path: Path) -> StoredMap:
        """Read the map at `path` and close it; another process may write it meanwhile. MapError as `read_map`."""
        return read_map(path)

    def write_model(self, model: ModelInfo, except_session: int | None = None) -> None:
        """Store the model of the embeddings, and mark running sessions as interrupted, except `except_session`."""
        with self._transaction() as connection:
            _mark_interrupted(connection, -1 if except_session is None else except_session)
            _set_meta(connection, 'model', unstructure(model))

    def write_origin(self, origin: GeoPoint | None) -> None:
        """Store the origin of the local frame, or that there is none."""
        with self._transaction() as connection:
            _set_meta(connection, 'origin', unstructure(origin))

    def write_session(
        self,
        session: StoredSession,
        *,
        changed: PlaceTable,
        anchors_m: NDArray[np.float64],
        before: Before,
        next_place_id: int,
        undoable: list[int],
    ) -> None:
        """Store a session and its changes since it was last stored.

        `changed` (N places) holds their present content, `anchors_m` (N, 2) their anchors, and `before` their content
        before the session. Sessions that are not in `undoable` can no longer be undone.
        """
        by_session = session.session_id
        old = PlaceTable.from_places([place for place in before.values() if place], changed.means.shape[1])
        with self._transaction() as connection:
            _mark_interrupted(connection, by_session)
            _write_session_row(connection, session)
            _set_meta(connection, 'next_place_id', next_place_id)
            _write_places(connection, changed, anchors_m)
            connection.executemany(
                f'INSERT OR REPLACE INTO undo VALUES ({by_session}, ?, 0{", ?" * len(_NOTHING)})',
                ((place_id, *_NOTHING) for place_id, place in before.items() if place is None),
            )
            connection.executemany(
                f'INSERT OR REPLACE INTO undo VALUES ({by_session}, ?, 1{", ?" * len(_NOTHING)})', table_to_rows(old)
            )
            connection.execute(f'DELETE FROM undo WHERE by_session NOT IN ({",".join(map(str, undoable))})')

    def undo_session(self, session: StoredSession, before: Before, anchors_m: NDArray[np.float64]) -> None:
        """Restore the content of a session's places from before it; `anchors_m` (N, 2) of the places that remain."""
        old = [place for place in before.values() if place]
        with self._transaction() as connection:
            _write_session_row(connection, session)
            removed = ((place_id,) for place_id, place in before.items() if place is None)
            connection.executemany('DELETE FROM places WHERE place_id = ?', removed)
            if old:
                _write_places(connection, PlaceTable.from_places(old, old[0].mean.size), anchors_m)
            connection.execute('DELETE FROM undo WHERE by_session = ?', (session.session_id,))

    def clear(self) -> Path:
        """Copy the map to ``<path>.<UTC stamp>.bak``, then delete its places and sessions; returns the copy's path."""
        stamp = datetime.datetime.now(datetime.timezone.utc).strftime('%Y%m%dT%H%M%S.%fZ')
        copy = self.path.with_name(f'{self.path.name}.{stamp}.bak')
        try:
            with contextlib.closing(sqlite3.connect(copy)) as target:
                self._open_connection().backup(target)
        except sqlite3.Error as error:
            copy.unlink(missing_ok=True)
            raise MapError(f'{copy}: the map could not be copied there ({error}), so it was not cleared') from error
        with self._transaction() as connection:
            for table in ('undo', 'places', 'sessions'):
                connection.execute(f'DELETE FROM {table}')
        return copy

    def close(self) -> None:
        """Close the file, without a further write."""
        if self._connection:
            self._connection.close()
            self._connection = None
        self._lock.release()

    def _open_connection(self) -> sqlite3.Connection:
        if self._connection is None:
            self._connection = sqlite3.connect(
                f'{self.path.resolve().as_uri()}?mode=rw',
                uri=True,
                isolation_level=None,
                check_same_thread=False,
                timeout=BUSY_TIMEOUT_S,
            )
            self._connection.execute('PRAGMA journal_mode = WAL')
            self._connection.execute('PRAGMA synchronous = FULL')
        return self._connection

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        try:
            connection = self._open_connection()
            connection.execute('BEGIN IMMEDIATE')
            try:
                yield connection
                connection.execute('COMMIT')
            except BaseException:
                if connection.in_transaction:
                    connection.execute('ROLLBACK')
                raise
        except sqlite3.Error as error:
            raise MapError(f'{self.path}: the map could not be written ({error}); the file is unchanged') from error


def _create(path: Path) -> None:
    """Create an empty map; the file gets its name when it is complete."""
    draft = path.with_name(path.name + '.new')
    try:
        draft.unlink(missing_ok=True)
        with contextlib.closing(sqlite3.connect(draft, isolation_level=None)) as connection:
            connection.executescript(schema.CREATE)
            now = datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds')
            for key, value in (('model', None), ('origin', None), ('next_place_id', 0), ('created', now)):
                _set_meta(connection, key, value)
            connection.execute('PRAGMA journal_mode = WAL')
        draft.rename(path)
        folder = os.open(path.parent, os.O_RDONLY)
        os.fsync(folder)
        os.close(folder)
    except (sqlite3.Error, OSError) as error:
        draft.unlink(missing_ok=True)
        raise MapError(f'{path}: a map cannot be created there ({error})') from error


def _set_meta(connection: sqlite3.Connection, key: str, value: object) -> None:
    connection.execute('INSERT OR REPLACE INTO meta VALUES (?, ?)', (key, json.dumps(value)))


def _mark_interrupted(connection: sqlite3.Connection, except_session: int) -> None:
    """Mark sessions that another process saved but did not end as interrupted; their changes stay."""
    connection.execute(
        "UPDATE sessions SET state = 'interrupted' WHERE state = 'running' AND session_id != ?", (except_session,)
    )


def _write_session_row(connection: sqlite3.Connection, session: StoredSession) -> None:
    row = (session.session_id, session.name, session.stamp_ns, session.state, json.dumps(dict(session.report)))
    connection.execute('INSERT OR REPLACE INTO sessions VALUES (?, ?, ?, ?, ?)', row)


def _write_places(connection: sqlite3.Connection, table: PlaceTable, anchors_m: NDArray[np.float64]) -> None:
    rows = zip(table_to_rows(table), anchors_m.tolist(), strict=True)
    connection.executemany(
        f'INSERT OR REPLACE INTO places VALUES (?{", ?" * 10})', ((*content, *anchor) for content, anchor in rows)
    )
