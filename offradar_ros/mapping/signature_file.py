"""Single signatures of a map file, read while a map server may write it."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Sequence
from pathlib import Path

from offradar_ros.errors import MapError
from offradar_ros.mapping.map_reader import (
    ALONE,
    WITH_LOG,
    DamagedMapError,
    FileState,
    begin_reading,
    explained,
    file_state,
    open_sqlite,
    require_file,
)
from offradar_ros.mapping.map_rows import checked_signature
from offradar_ros.types import ScanKey

_TRIES = 5
"""How often it is begun again because a writer came between."""


class SignatureFile:
    """Reads signatures from the map at a path, as of its last save, without a change to it. Not thread-safe.

    The file stays open between calls, and is opened again when anybody has written it, or put another one there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._connection: sqlite3.Connection | None = None
        self._state: FileState | None = None
        self._version = 0

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """The signatures of these scans, at most 8 KB each, without those that the map has none of.

        Each is what was written: MapError for one that is not, and for a file that is missing or not a map.
        """
        for _ in range(_TRIES):
            state = file_state(self._path)
            try:
                # A log is of a writer that is just at work, or that was killed.
                return self._read_beside_log(scans) if state.log else self._read_alone(state, scans)
            except MapError:
                self.close()
                if file_state(self._path) == state:
                    raise
        raise MapError(f'{self._path}: another process writes the map again and again: a signature cannot be read')

    def close(self) -> None:
        """Close the file; the next call opens it again."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _read_alone(self, state: FileState, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """From the file without a log, which SQLite takes to be immutable: MapError if it was not."""
        if self._state != state:
            self.close()
        with explained(self._path):
            if self._connection is None:
                self._connection, self._version = self._opened(ALONE)
                self._state = state
            found = _looked_up(self._connection, self._version, scans)
        if file_state(self._path) != state:
            raise MapError(f'{self._path}: was written while it was read')
        return found

    def _read_beside_log(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """From the file and its log; it is not kept open, so that SQLite's files beside it can go."""
        self.close()
        try:
            with explained(self._path):
                connection, version = self._opened(WITH_LOG)
        except DamagedMapError:
            # A log of another file, maybe.
            with explained(self._path):
                connection, version = self._opened(ALONE)
        with explained(self._path), contextlib.closing(connection):
            return _looked_up(connection, version, scans)

    def _opened(self, mode: str) -> tuple[sqlite3.Connection, int]:
        """A connection that holds no lock, and the version of the map."""
        require_file(self._path)
        connection = open_sqlite(self._path, mode)
        try:
            version = begin_reading(self._path, connection, mode).version
            connection.execute('ROLLBACK')
        except BaseException:
            connection.close()
            raise
        return connection, version


def _looked_up(connection: sqlite3.Connection, version: int, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
    found: dict[ScanKey, bytes] = {}
    if version < 3:
        return found
    connection.execute('BEGIN')
    try:
        for scan in scans:
            row = connection.execute(
                'SELECT digest, content FROM signatures LEFT JOIN signature_contents USING (content_id) '
                'WHERE session_id = ? AND stamp_ns = ?',
                scan,
            ).fetchone()
            if row:
                found[scan] = checked_signature(scan, *row)
    finally:
        connection.execute('ROLLBACK')
    return found
