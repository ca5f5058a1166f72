"""The rows of an open map file, each checked when it is read: its digest, and whether its content is possible."""

from __future__ import annotations

import itertools
import math
import sqlite3
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.bounded_input import parse_json
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.place_check import MAX_COORDINATE_M, MAX_PLACE_ID, MAX_SESSION_ID, place_problem
from offradar_ros.mapping.place_columns import capacity_for, place_of
from offradar_ros.mapping.place_rows import (
    CONTENTS,
    content_columns,
    inserted_digests,
    place_digests,
    rows_to_table,
    undo_digests,
)
from offradar_ros.mapping.seal import (
    RowSum,
    Seal,
    digests,
    is_seal,
    meta_bytes,
    read_seal,
    session_bytes,
    signature_bytes,
)
from offradar_ros.mapping.stored_map import Before, StoredSession
from offradar_ros.records import structure
from offradar_ros.types import MAX_SIGNATURE_BYTES, PlaceTable, ScanKey

STATES = {'running', 'ended', 'interrupted', 'undone'}
_BATCH = 1024
"""Rows read at once: few enough for the processor's cache."""
_CONTENTS = 64
"""Signatures read at once: those of a damaged file may be far too long."""


class Batch(NamedTuple):
    """Some places: their content, and (N, 2) float64 where each was first mapped."""

    table: PlaceTable
    anchors_m: NDArray[np.float64]


class MapRows:
    """Reads a map file of any version within one transaction.

    ValueError, ConfigError or RefusedInput say what is damaged. The digests of a table are compared with its sum when
    all of it has been read.
    """

    def __init__(self, connection: sqlite3.Connection, version: int) -> None:
        self.connection = connection
        self.version = version
        self.seal: Seal | None = read_seal(connection, version) if version > 1 else None
        meta = self._meta()
        self.created = str(meta['created'])
        self.model = structure(ModelInfo, meta['model']) if meta['model'] else None
        self.origin = structure(GeoPoint, meta['origin']) if meta['origin'] else None
        self.next_place_id = meta['next_place_id']
        if type(self.next_place_id) is not int or not 0 <= self.next_place_id <= MAX_PLACE_ID + 1:
            raise ValueError(f'the id of the next place is {self.next_place_id}')
        self.sessions = self._sessions()
        self._session_ids = np.array([session.session_id for session in self.sessions], np.int64)

    @property
    def dimension(self) -> int:
        """d of the model; 0 without one."""
        return self.model.dimension if self.model else 0

    @property
    def running_session_id(self) -> int | None:
        """Id of the session that was saved but not ended, or None."""
        return max((session.session_id for session in self.sessions if session.state == 'running'), default=None)

    def capacity(self) -> int:
        """Capacity for the places of the map and more, by ids and file size: COUNT(*) would read all of it."""
        newest = self.connection.execute('SELECT max(place_id) FROM places').fetchone()[0]
        size = (self.connection.execute(f'PRAGMA {name}').fetchone()[0] for name in ('page_count', 'page_size'))
        return capacity_for(min((newest or 0) + 1, math.prod(size) // max(4 * self.dimension, 1)))

    def places(self) -> Iterator[Batch]:
        """All places in ascending order of id."""
        found, last_id = RowSum(), -1
        cursor = self.connection.execute(
            f'SELECT {content_columns(self.version)}, anchor_x_m, anchor_y_m, {self._digest} FROM places '
            'ORDER BY place_id'
        )
        for rows in _batches(cursor):
            table = rows_to_table(rows, self.dimension)
            anchors_m = np.array([row[CONTENTS : CONTENTS + 2] for row in rows], np.float64)
            if self.seal:
                found = self._checked('places', rows, place_digests(table, anchors_m), found)
            self._require_possible(table)
            if not (np.abs(anchors_m) <= MAX_COORDINATE_M).all():
                raise ValueError(f'a place was first mapped farther than {MAX_COORDINATE_M:g} m from the origin')
            last_id = _last_in_order('places', [last_id, *table.place_ids.tolist()])
            yield Batch(table, anchors_m)
        self._require_complete('places', found)

    def before(self, session_id: int | None = None) -> dict[int, Before]:
        """By session, what its places held before it; only for `session_id` where that is given."""
        before: dict[int, Before] = {}
        found, last = RowSum(), (-1, -1)
        cursor = self.connection.execute(
            f'SELECT {content_columns(self.version)}, by_session, existed, {self._digest} FROM undo '
            'ORDER BY by_session, place_id'
        )
        for rows in _batches(cursor):
            ids, by_sessions = (_whole_numbers([row[column] for row in rows]) for column in (0, CONTENTS))
            states = [row[CONTENTS + 1] for row in rows]
            empty = (None,) * (CONTENTS - 1)
            if set(states) - {0, 1} or any(row[1:CONTENTS] != empty for row in rows if not row[CONTENTS + 1]):
                raise ValueError('a place from before a session neither existed nor is empty')
            existed = np.array(states, np.bool_)
            table = rows_to_table([row for row in rows if row[CONTENTS + 1]], self.dimension)
            self._require_possible(table)
            self._require_known_ids(ids)
            self._require_known_sessions(by_sessions)
            last = _last_in_order('undo', [last, *zip(by_sessions.tolist(), ids.tolist(), strict=True)])
            if self.seal:
                values = np.empty(len(rows), np.int64)
                values[existed] = undo_digests(table, by_sessions[existed])
                values[~existed] = inserted_digests(ids[~existed], by_sessions[~existed])
                found = self._checked('undo', rows, values, found)
            wanted = by_sessions == session_id if session_id is not None else np.ones(len(rows), np.bool_)
            for place_id, by_session in zip(ids[wanted].tolist(), by_sessions[wanted].tolist(), strict=True):
                before.setdefault(by_session, {})[place_id] = None
            of_table = by_sessions[existed]
            for row in np.flatnonzero(wanted[existed]).tolist():
                before[int(of_table[row])][int(table.place_ids[row])] = place_of(table, row)
        self._require_complete('undo', found)
        return before

    def check_signature_sum(self) -> None:
        """Compare the digests of all signatures with their sum, without reading a signature."""
        for _ in self._signature_rows():
            pass

    def signatures(self) -> Iterator[tuple[ScanKey, bytes]]:
        """All signatures, by the scans that they are of."""
        if self.version < 3:
            return
        named: dict[int, tuple[ScanKey, int]] = {}
        for session_id, stamp_ns, content_id, digest in self._signature_rows():
            if content_id in named:
                raise ValueError('two scans have one signature')
            named[content_id] = ScanKey(session_id, stamp_ns), digest
        cursor = self.connection.execute('SELECT content_id, content FROM signature_contents ORDER BY content_id')
        while contents := cursor.fetchmany(_CONTENTS):
            for content_id, content in contents:
                if content_id not in named:
                    raise ValueError(f'signature {content_id} is of no scan')
                scan, digest = named.pop(content_id)
                yield scan, checked_signature(scan, digest, content)
        if named:
            raise ValueError(f'{len(named)} signatures are missing')

    def _signature_rows(self) -> Iterator[tuple[int, int, int, int]]:
        """Session, stamp, id of the content and digest of each signature."""
        if self.version < 3:
            return
        found, last = RowSum(), (0, 0)
        cursor = self.connection.execute(
            'SELECT session_id, stamp_ns, content_id, digest FROM signatures ORDER BY session_id, stamp_ns'
        )
        for rows in _batches(cursor):
            session_ids, _, _, values = (_whole_numbers([row[column] for row in rows]) for column in range(4))
            self._require_known_sessions(session_ids)
            last = _last_in_order('signatures', [last, *(row[:2] for row in rows)])
            found = found.with_rows(values)
            yield from rows
        self._require_complete('signatures', found)

    @property
    def _digest(self) -> str:
        return 'digest' if self.seal else '0'

    def _meta(self) -> dict[str, Any]:
        rows = self.connection.execute(f'SELECT key, value, {self._digest} FROM meta ORDER BY key').fetchall()
        rows = [row for row in rows if not is_seal(row[0])]
        if any(type(value) is not str for row in rows for value in row[:2]):
            raise ValueError('its table meta holds something other than text')
        _last_in_order('meta', ['', *(row[0] for row in rows)])
        if self.seal:
            values = digests('meta', (meta_bytes(key, value) for key, value, _ in rows))
            self._require_complete('meta', self._checked('meta', rows, values, RowSum()))
        return {key: parse_json(value) for key, value, _ in rows}

    def _sessions(self) -> tuple[StoredSession, ...]:
        rows = self.connection.execute(
            f'SELECT session_id, name, stamp_ns, state, report, {self._digest} FROM sessions ORDER BY session_id'
        ).fetchall()
        for row in rows:
            if tuple(map(type, row)) != (int, str, int, str, str, int):
                raise ValueError('a session holds a value of another type')
        _last_in_order('sessions', [0, *(row[0] for row in rows)])
        if self.seal:
            values = digests('sessions', (session_bytes(row[:5]) for row in rows))
            self._require_complete('sessions', self._checked('sessions', rows, values, RowSum()))
        return tuple(_session(*row[:5]) for row in rows)

    def _checked(self, name: str, rows: list[Any], values: NDArray[np.int64], found: RowSum) -> RowSum:
        """`found` with these rows; ValueError for a row whose digest is not that of its content."""
        wrong = np.flatnonzero(_whole_numbers([row[-1] for row in rows]) != values)
        if len(wrong):
            raise ValueError(f'{len(wrong)} rows of {name} are not as written, the first is {rows[wrong[0]][0]}')
        return found.with_rows(values)

    def _require_complete(self, name: str, found: RowSum) -> None:
        if self.seal and self.seal.sums[name] != found:
            raise ValueError(f'it should hold {self.seal.sums[name].rows} rows of {name}, and not these {found.rows}')

    def _require_possible(self, table: PlaceTable) -> None:
        problem = place_problem(table)
        if problem:
            raise ValueError(problem)
        self._require_known_ids(table.place_ids)
        self._require_known_sessions(table.session_ids)

    def _require_known_ids(self, ids: NDArray[np.int64]) -> None:
        if not ((ids >= 0) & (ids < self.next_place_id)).all():
            raise ValueError(f'a place has an id outside 0 … {self.next_place_id - 1}')

    def _require_known_sessions(self, ids: NDArray[Any]) -> None:
        if not np.isin(ids, self._session_ids).all():
            raise ValueError('a place is of a session that the map does not know')


def _session(session_id: int, name: str, stamp_ns: int, state: str, text: str) -> StoredSession:
    report = parse_json(text)
    if not 0 < session_id <= MAX_SESSION_ID or state not in STATES or not isinstance(report, dict):
        raise ValueError(f'session {session_id} is not possible')
    counts = [report.get(name) for name in ('inserted', 'replaced')]
    if state != 'undone' and not all(type(count) is int and count >= 0 for count in counts):
        raise ValueError(f'the report of session {session_id} does not say what it changed')
    return StoredSession(session_id, name, stamp_ns, state, report)


def _last_in_order(name: str, keys: list[Any]) -> Any:
    """The last of some keys; ValueError unless they ascend, as a table that is searched must."""
    if not all(key < following for key, following in itertools.pairwise(keys)):
        raise ValueError(f'the rows of {name} are not in the order of their keys')
    return keys[-1]


def _whole_numbers(values: list[Any]) -> NDArray[np.int64]:
    if not all(type(value) is int for value in values):
        raise ValueError('a value is not a whole number')
    return np.array(values, np.int64)


def checked_signature(scan: ScanKey, digest: object, content: object) -> bytes:
    """The content of a signature; ValueError unless it is what was written with this digest for this scan."""
    if not isinstance(content, bytes) or not 0 < len(content) <= MAX_SIGNATURE_BYTES:
        raise ValueError(f'the signature of the scan at {scan.stamp_ns} ns is not one')
    if digests('signatures', [signature_bytes(scan, content)])[0] != digest:
        raise ValueError(f'the signature of the scan at {scan.stamp_ns} ns is not as written')
    return content


def _batches(cursor: sqlite3.Cursor) -> Iterator[list[Any]]:
    while batch := cursor.fetchmany(_BATCH):
        yield batch


def require_undoable(before: dict[int, Before], place_ids: NDArray[np.int64]) -> None:
    """ValueError if an undo would touch a place that is not in the map."""
    changed = np.array(sorted({place_id for of_session in before.values() for place_id in of_session}), np.int64)
    if not np.isin(changed, place_ids).all():
        raise ValueError('a session changed a place that is not in the map')
