"""Digests that show whether a map file holds what was written: one of each row, and a sum over all rows of a table.

A row whose content is not what was written has another digest, a row that is missing or too many changes the sum. The
sums stand in the row `seal` of the table `meta`, whose own digest, the mark, thus identifies the content of a map.
Digests find damage. They do not stop somebody who forges a map on purpose.
"""

from __future__ import annotations

import dataclasses
import hashlib
import secrets
import sqlite3
import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.bounded_input import parse_json
from offradar_ros.mapping.schema import VERSION
from offradar_ros.records import structure, to_json
from offradar_ros.types import ScanKey

_OF_PLACES = ('meta', 'sessions', 'places', 'undo')
SEALED_TABLES = {2: _OF_PLACES, 3: (*_OF_PLACES, 'signatures'), 4: (*_OF_PLACES, 'signatures')}
"""The tables that are summed, by version of the map."""
_KEY = 'seal'
_WRAP = 2**64
_SCAN = struct.Struct('<qq')


def digests(table: str, rows: Iterable[bytes | memoryview]) -> NDArray[np.int64]:
    """(N,) int64 digests of N rows of a table, each given as bytes."""
    empty = hashlib.blake2b(digest_size=8, person=table.encode())
    found = []
    for row in rows:
        state = empty.copy()
        state.update(row)
        found.append(state.digest())
    return np.frombuffer(b''.join(found), '<i8').astype(np.int64, copy=False)


def digest(table: str, row: bytes) -> int:
    """The digest of one row."""
    return int(digests(table, (row,))[0])


@dataclasses.dataclass(frozen=True)
class RowSum:
    """Number of rows, and the sum of their digests modulo 2⁶⁴."""

    rows: int = 0
    total: int = 0

    def with_rows(self, added: NDArray[np.int64]) -> RowSum:
        """The sum after rows with these (N,) digests were added."""
        return RowSum(self.rows + len(added), (self.total + _sum(added)) % _WRAP)

    def without_rows(self, removed: NDArray[np.int64]) -> RowSum:
        """The sum after rows with these (N,) digests were removed."""
        return RowSum(self.rows - len(removed), (self.total - _sum(removed)) % _WRAP)


def _sum(values: NDArray[np.int64]) -> int:
    return int(values.view(np.uint64).sum(dtype=np.uint64))


@dataclasses.dataclass(frozen=True)
class Seal:
    """What identifies the content of a map file.

    Attributes:
        identity: 32 random hex digits of the file, made when it was created.
        generation: how many transactions have changed the file.
        folded_generation: the generation that the file alone, without the log beside it, last held for sure.
        folded_mark: the mark of that generation.
        sums: by table, over all rows but this one.
    """

    identity: str
    generation: int
    folded_generation: int
    folded_mark: int
    sums: Mapping[str, RowSum]

    @classmethod
    def new(cls) -> Seal:
        """The seal of a new map without rows."""
        return cls(secrets.token_hex(16), 0, 0, 0, {table: RowSum() for table in SEALED_TABLES[VERSION]})

    @property
    def mark(self) -> int:
        """Digest of the seal, thus of all rows."""
        return digest('meta', meta_bytes(_KEY, self._text()))

    def next(self, sums: Mapping[str, RowSum], *, is_folded: bool) -> Seal:
        """The seal after a transaction that led to `sums`; `is_folded` if the file alone holds what this one seals."""
        following = dataclasses.replace(self, generation=self.generation + 1, sums=dict(sums))
        if not is_folded:
            return following
        return dataclasses.replace(following, folded_generation=self.generation, folded_mark=self.mark)

    def follows(self, alone: Seal) -> bool:
        """Whether a file that holds `alone` without its log holds this content with it: the log belongs to the file."""
        if self.identity != alone.identity:
            return False
        between = self.folded_generation < alone.generation < self.generation
        return alone.mark in (self.mark, self.folded_mark) or between

    def write(self, connection: sqlite3.Connection) -> None:
        """Store the seal; the last statement of each transaction."""
        connection.execute('INSERT OR REPLACE INTO meta VALUES (?, ?, ?)', (_KEY, self._text(), self.mark))

    def _text(self) -> str:
        return to_json(self)


def read_seal(connection: sqlite3.Connection, version: int = VERSION) -> Seal:
    """The seal of an open map file of this version; ValueError or ConfigError if it is missing or damaged."""
    row = connection.execute('SELECT value, digest FROM meta WHERE key = ?', (_KEY,)).fetchone()
    if row is None or type(row[0]) is not str:
        raise ValueError('it has no seal')
    seal = structure(Seal, parse_json(row[0]))
    if row != (seal._text(), seal.mark) or set(seal.sums) != set(SEALED_TABLES[version]):
        raise ValueError('the seal does not have its digest')
    return seal


def is_seal(key: object) -> bool:
    """Whether a row of `meta` is the seal, which no sum includes."""
    return key == _KEY


def meta_bytes(key: str, value: str) -> bytes:
    """A row of `meta`, for its digest."""
    return f'{key}\0{value}'.encode()


def session_bytes(row: tuple[Any, ...]) -> bytes:
    """A row of `sessions` without its digest, for its digest."""
    return to_json(list(row)).encode()


def signature_bytes(scan: ScanKey, content: bytes) -> bytes:
    """A row of `signatures` with the content that it names, for its digest."""
    return _SCAN.pack(*scan) + content
