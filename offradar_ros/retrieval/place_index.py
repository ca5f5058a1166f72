"""Exact Euclidean nearest neighbours over places that come, change and go."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.types import Candidate, PlaceTable, Pose

_ROUND_OFF = 2.0**-24
"""Relative error of one single-precision operation."""

_TINY = float(np.finfo(np.float32).tiny)
"""Below this single precision loses its relative accuracy."""

_LARGEST_SQUARE = 1e37
"""Squares beyond this could overflow single precision: such a search is done in double precision alone."""

_CHUNK = 1024
"""Rows worked on at once in double precision."""


_GROUPS = 16384
"""Groups of rows that the k least scores are looked for in: far more than k."""


def _least(scores: NDArray[np.float32], k: int, margin: float) -> NDArray[np.intp]:
    """Ascending rows of the k least scores and of all that exceed the k-th by no more than `margin`, and few more.

    What is taken for the k-th is the k-th of the least of each group, which takes one pass; a group whose least is too
    much is done with. Groups are strided: the places of a road lie beside one another, and so do those that resemble a
    query.
    """
    rows = len(scores) // _GROUPS
    if rows > 4 and 16 * k <= _GROUPS:
        grouped, rest = scores[: rows * _GROUPS].reshape(rows, _GROUPS), scores[rows * _GROUPS :]
        least = grouped.min(axis=0)
        limit = _limit(least, k, margin)
        # Infinite where almost all rows are left out.
        if limit < np.inf:
            groups = np.flatnonzero(least <= limit)
            row, group = np.nonzero(grouped[:, groups] <= limit)
            return np.concatenate([row * _GROUPS + groups[group], rows * _GROUPS + np.flatnonzero(rest <= limit)])
    return np.flatnonzero(scores <= _limit(scores, k, margin))


def _limit(scores: NDArray[np.float32], k: int, margin: float) -> float:
    kth = np.partition(scores, k - 1)[k - 1]
    return float(np.nextafter(np.float32(float(kth) + margin), np.float32(np.inf)))


class PlaceIndex:
    """Brute force over one preallocated matrix: a change costs microseconds, and nothing is approximate.

    One pass computes |x|² − 2 x·q in single precision, which cancels badly for x near q: sums of d + 1 terms, so that
    its error is at most (d + 8) 2⁻²⁴ (|x| + |q|)². Every row that this bound leaves in question is then measured again,
    as |x − q| in double precision.
    """

    def __init__(self, dimension: int, capacity: int = 16) -> None:
        self.dimension = dimension
        self._columns = PlaceColumns(dimension, capacity)
        self._squares = np.empty(capacity, np.float32)
        self._largest: float | None = None

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def place_ids(self) -> NDArray[np.int64]:
        """(N,) int64, ascending; a view, valid until the next change."""
        return self._columns.table.place_ids

    def place_ids_at(self, stamp_ns: int) -> NDArray[np.int64]:
        """(M,) int64 ids of the places that hold the scan of this stamp."""
        table = self._columns.table
        found: NDArray[np.int64] = table.place_ids[table.stamps_ns == stamp_ns]
        return found

    def upsert(self, table: PlaceTable) -> None:
        """Overwrite known places and add new ones; RefusedInput if a mean is not of d finite numbers."""
        self.check(table)
        before = len(self)
        _, known = self._columns.find(table.place_ids)
        self._columns.upsert(table)
        rows, _ = self._columns.find(table.place_ids)
        if not np.all(rows[~known] >= before):
            self._measure(slice(0, len(self)))
        elif known.any():
            self._measure(rows)
        else:
            self._measure(slice(before, len(self)))

    def remove(self, place_ids: NDArray[np.int64]) -> None:
        """Forget places; an unknown id is no error."""
        if self._columns.find(place_ids)[1].any():
            self._columns.remove(place_ids)
            self._measure(slice(0, len(self)))

    def search(self, mean: NDArray[np.float32], k: int, without: NDArray[np.int64] | None = None) -> list[Candidate]:
        """The k places nearest to `mean` (d,), nearest first, of equally near ones the lowest id first.

        Fewer where there are fewer; `without` are ids left out. Distances are exact, rounded to single precision.
        """
        query = np.asarray(mean, np.float32)
        rows, known = self._columns.find(np.empty(0, np.int64) if without is None else without)
        excluded = np.unique(rows[known])
        k = min(k, len(self) - len(excluded))
        if k <= 0:
            return []
        rows = self._shortlist(query, k, excluded)
        distances = self._distances(query, rows)
        nearest = np.argsort(distances, kind='stable')[:k]
        return self._candidates(rows[nearest], distances[nearest])

    def _shortlist(self, query: NDArray[np.float32], k: int, excluded: NDArray[np.intp]) -> NDArray[np.intp]:
        """Ascending rows that are sure to hold the k nearest."""
        squares = self._squares[: len(self)]
        largest = (np.sqrt(self._largest_square()) + np.linalg.norm(query.astype(np.float64))) ** 2
        if not largest < _LARGEST_SQUARE:
            return np.setdiff1d(np.arange(len(self)), excluded)
        scores = self._columns.table.means @ (np.float32(-2.0) * query)
        scores += squares
        scores[excluded] = np.inf
        bound = (self.dimension + 8) * (_ROUND_OFF * largest + _TINY)
        return _least(scores, k, 2.0 * bound)

    def _distances(self, query: NDArray[np.float32], rows: NDArray[np.intp]) -> NDArray[np.float32]:
        distances = np.empty(len(rows), np.float32)
        for start in range(0, len(rows), _CHUNK):
            part = slice(start, start + _CHUNK)
            offsets = self._columns.table.means[rows[part]].astype(np.float64) - query
            with np.errstate(over='ignore'):
                distances[part] = np.sqrt(np.sum(offsets * offsets, axis=1))
        return distances

    def _candidates(self, rows: NDArray[np.intp], distances: NDArray[np.float32]) -> list[Candidate]:
        table = self._columns.table
        places = zip(
            table.place_ids[rows].tolist(),
            distances.tolist(),
            table.uncertainties[rows].tolist(),
            table.positions_m[rows].tolist(),
            table.yaws_rad[rows].tolist(),
            strict=True,
        )
        return [Candidate(place_id, d, u, Pose(x_m, y_m, z_m, yaw)) for place_id, d, u, (x_m, y_m, z_m), yaw in places]

    def _largest_square(self) -> float:
        """Looked for once after each change."""
        if self._largest is None:
            self._largest = float(self._squares[: len(self)].max())
        return self._largest

    def _measure(self, rows: NDArray[np.intp] | slice) -> None:
        """Squared lengths of rows that changed, infinite where they overflow."""
        self._largest = None
        if len(self) > len(self._squares):
            grown = np.empty(max(len(self), 2 * len(self._squares)), np.float32)
            grown[: len(self._squares)] = self._squares
            self._squares = grown
        stored = self._columns.table.means
        first, end = (rows.start, rows.stop) if isinstance(rows, slice) else (0, len(rows))
        for start in range(first, end, _CHUNK):
            part = slice(start, min(start + _CHUNK, end))
            some = part if isinstance(rows, slice) else rows[part]
            means = stored[some].astype(np.float64)
            with np.errstate(over='ignore'):
                self._squares[some] = np.einsum('ij,ij->i', means, means)

    def check(self, table: PlaceTable) -> None:
        """RefusedInput (`wrong_dimension`, `invalid_place`) if `upsert` would refuse these places."""
        if table.means.shape != (len(table), self.dimension):
            raise RefusedInput(
                'wrong_dimension',
                f'places of dimension {table.means.shape[-1]} refused: the map has dimension {self.dimension}',
            )
        # Extremes of each row instead of a flag for each value, which would take a quarter of the map's memory.
        least, most = table.means.min(axis=1, initial=0.0), table.means.max(axis=1, initial=0.0)
        wrong = np.flatnonzero(~(np.isfinite(least) & np.isfinite(most)))
        if len(wrong):
            raise RefusedInput('invalid_place', f'place {table.place_ids[wrong[0]]}: its mean is not finite')
