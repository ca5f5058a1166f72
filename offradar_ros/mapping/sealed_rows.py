"""Writes rows of a map file with their digests, and keeps the sums of its seal."""

from __future__ import annotations

import itertools
import json
import sqlite3
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.mapping.place_columns import take_rows
from offradar_ros.mapping.place_rows import CONTENTS, inserted_digests, place_digests, table_to_rows, undo_digests
from offradar_ros.mapping.seal import RowSum, digest, digests, meta_bytes, session_bytes, signature_bytes
from offradar_ros.mapping.stored_map import Before, StoredSession
from offradar_ros.types import PlaceTable, ScanKey

_BATCH = 500
"""Rows written at once: as many as any SQLite takes parameters of a statement."""


class SealedRows:
    """The rows of an open map file, within one transaction; `sums` becomes part of its seal."""

    def __init__(self, connection: sqlite3.Connection, sums: Mapping[str, RowSum]) -> None:
        self._connection = connection
        self.sums = dict(sums)

    def put_meta(self, key: str, value: object) -> None:
        """Write a value as JSON."""
        row = (key, json.dumps(value))
        self._forget('meta', 'key = ?', [key])
        self._insert('meta', [row], _one(digest('meta', meta_bytes(*row))))

    def put_session(self, session: StoredSession) -> None:
        """Write a session."""
        report = json.dumps(dict(session.report))
        row = (session.session_id, session.name, session.stamp_ns, session.state, report)
        self._forget('sessions', 'session_id = ?', [session.session_id])
        self._insert('sessions', [row], _one(digest('sessions', session_bytes(row))))

    def mark_interrupted(self, except_session: int | None) -> None:
        """Mark sessions that another process saved but did not end as interrupted; their changes stay."""
        rows = self._connection.execute(
            "SELECT session_id, name, stamp_ns, report FROM sessions WHERE state = 'running'"
        ).fetchall()
        for session_id, name, stamp_ns, report in rows:
            if session_id != except_session:
                self.put_session(StoredSession(session_id, name, stamp_ns, 'interrupted', json.loads(report)))

    def put_places(self, table: PlaceTable, anchors_m: NDArray[np.float64]) -> None:
        """Write places (N) and where they were first mapped (N, 2)."""
        for part in _parts(len(table)):
            places, anchors = take_rows(table, part), anchors_m[part]
            self._forget_keys('places', '', places.place_ids)
            rows = zip(table_to_rows(places), anchors.tolist(), strict=True)
            self._insert('places', ((*content, *anchor) for content, anchor in rows), place_digests(places, anchors))

    def remove_places(self, place_ids: Sequence[int]) -> None:
        """Remove these places."""
        for part in _parts(len(place_ids)):
            self._forget_keys('places', '', np.array(place_ids[part], np.int64), remove=True)

    def put_undo(self, by_session: int, before: Before, dimension: int) -> None:
        """Write what places held before a session."""
        ids = np.array(list(before), np.int64)
        new = np.array([place_id for place_id, place in before.items() if place is None], np.int64)
        old = PlaceTable.from_places([place for place in before.values() if place], dimension)
        for part in _parts(len(ids)):
            self._forget_keys('undo', f'by_session = {by_session:d} AND ', ids[part])
        for part in _parts(len(new)):
            rows = ((by_session, place_id, 0, *(None,) * (CONTENTS - 1)) for place_id in new[part].tolist())
            self._insert('undo', rows, inserted_digests(new[part], _repeated(by_session, len(new[part]))))
        for part in _parts(len(old)):
            places = take_rows(old, part)
            rows = ((by_session, content[0], 1, *content[1:]) for content in table_to_rows(places))
            self._insert('undo', rows, undo_digests(places, _repeated(by_session, len(places))))

    def keep_undo(self, of_sessions: Sequence[int]) -> None:
        """Remove what places held before all other sessions."""
        kept = ','.join(str(int(session)) for session in of_sessions)
        # By session, not by row: each save would read all that can be undone.
        condition = f'by_session IN (SELECT session_id FROM sessions WHERE session_id NOT IN ({kept}))'
        self._forget('undo', condition, [], remove=True)

    def remove_undo(self, by_session: int) -> None:
        """Remove what places held before a session."""
        self._forget('undo', 'by_session = ?', [by_session], remove=True)

    def put_signatures(self, signatures: Mapping[ScanKey, bytes]) -> None:
        """Write signatures by their scans."""
        self.remove_signatures(signatures)
        newest = self._connection.execute('SELECT max(content_id) FROM signature_contents').fetchone()[0]
        contents = list(enumerate(signatures.values(), start=1 if newest is None else newest + 1))
        self._connection.executemany('INSERT INTO signature_contents VALUES (?, ?)', contents)
        rows = ((*scan, content_id) for scan, (content_id, _) in zip(signatures, contents, strict=True))
        self._insert('signatures', rows, digests('signatures', itertools.starmap(signature_bytes, signatures.items())))

    def remove_signatures(self, scans: Collection[ScanKey]) -> None:
        """Remove the signatures of these scans, of those that have one."""
        keys = list(scans)
        # A key is two parameters.
        for part in _parts(len(keys), _BATCH // 2):
            values = [value for key in keys[part] for value in key]
            condition = f'(session_id, stamp_ns) IN (VALUES (?, ?){", (?, ?)" * (len(values) // 2 - 1)})'
            self._remove_signatures(condition, values)

    def remove_signatures_of(self, session_id: int) -> None:
        """Remove the signatures of the scans of a session."""
        self._remove_signatures('session_id = ?', [session_id])

    def _remove_signatures(self, condition: str, values: Sequence[Any]) -> None:
        named = f'SELECT content_id FROM signatures WHERE {condition}'
        self._connection.execute(f'DELETE FROM signature_contents WHERE content_id IN ({named})', values)
        self._forget('signatures', condition, values, remove=True)

    def clear(self) -> None:
        """Remove all places and sessions."""
        for table in ('undo', 'places', 'sessions', 'signatures'):
            self._connection.execute(f'DELETE FROM {table}')
            self.sums[table] = RowSum()
        self._connection.execute('DELETE FROM signature_contents')

    def _insert(self, table: str, rows: Iterable[tuple[Any, ...]], values: NDArray[np.int64]) -> None:
        sealed = ((*row, value) for row, value in zip(rows, values.tolist(), strict=True))
        first = next(sealed, None)
        if first is None:
            return
        # Rows whose key is in the table are replaced; their digests are forgotten already.
        statement = f'INSERT OR REPLACE INTO {table} VALUES (?{", ?" * (len(first) - 1)})'
        self._connection.executemany(statement, itertools.chain([first], sealed))
        self.sums[table] = self.sums[table].with_rows(values)

    def _forget_keys(self, table: str, condition: str, ids: NDArray[np.int64], remove: bool = False) -> None:
        keys = ids.tolist()
        self._forget(table, f'{condition}place_id IN (?{", ?" * (len(keys) - 1)})', keys, remove)

    def _forget(self, table: str, condition: str, values: Sequence[Any], remove: bool = False) -> None:
        """Take rows out of the sum, and out of the table if they are not replaced now."""
        rows = self._connection.execute(f'SELECT digest FROM {table} WHERE {condition}', values)
        self.sums[table] = self.sums[table].without_rows(np.array([row[0] for row in rows], np.int64))
        if remove:
            self._connection.execute(f'DELETE FROM {table} WHERE {condition}', values)


def _parts(count: int, size: int = _BATCH) -> Iterator[slice]:
    return (slice(start, start + size) for start in range(0, count, size))


def _one(value: int) -> NDArray[np.int64]:
    return np.array([value], np.int64)


def _repeated(by_session: int, count: int) -> NDArray[np.int64]:
    return np.full(count, by_session, np.int64)
