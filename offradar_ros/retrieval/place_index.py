"""Exact Euclidean nearest neighbours over places that are added, changed and removed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.place_check import place_problem
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.types import Candidate, PlaceTable, Pose, ScanKey

_UNIT_ROUNDOFF = 2.0**-24
"""Unit round-off of single precision: the relative error of one operation."""

_TINY = float(np.finfo(np.float32).tiny)
"""The smallest normal number: below it, single precision loses relative accuracy."""

_LARGEST_SQUARE = 1e37
"""Squares beyond this could overflow single precision: such a search uses double precision only."""

_DOUBLES_AT_ONCE = 2**17
"""How many numbers are converted to double precision at once: they fit the processor's cache."""

_BLOCK = 256
"""How many queries, and places, are multiplied at once."""

_GROUPS = 16384
"""Number of groups of rows in the search for the k smallest scores: far more than k."""


def _rows_within_margin(scores: NDArray[np.float32], k: int, margin: float) -> NDArray[np.intp]:
    """Ascending rows of all (N,) scores up to the k-th smallest plus `margin`, and a few more.

    The k-th smallest of the groups' minima bounds the k-th smallest score from above, and takes one pass; groups whose
    minimum is above the limit are skipped. Groups are strided, because neighbouring rows are places of one road, and
    the places that resemble a query are neighbours.
    """
    rows = len(scores) // _GROUPS
    if rows > 4 and 16 * k <= _GROUPS:
        grouped, rest = scores[: rows * _GROUPS].reshape(rows, _GROUPS), scores[rows * _GROUPS :]
        minima = grouped.min(axis=0)
        limit = _limit(minima, k, margin)
        # Infinite where almost all rows are excluded.
        if limit < np.inf:
            groups = np.flatnonzero(minima <= limit)
            row, group = np.nonzero(grouped[:, groups] <= limit)
            return np.concatenate([row * _GROUPS + groups[group], rows * _GROUPS + np.flatnonzero(rest <= limit)])
    return np.flatnonzero(scores <= _limit(scores, k, margin))


def _limit(scores: NDArray[np.float32], k: int, margin: float) -> float:
    """The k-th smallest score plus `margin`, rounded up."""
    kth = np.partition(scores, k - 1)[k - 1]
    return float(np.nextafter(np.float32(float(kth) + margin), np.float32(np.inf)))


class PlaceIndex:
    """Exhaustive search over one preallocated matrix: exact, and a change takes microseconds.

    One pass computes |x|² − 2 x·q in single precision, a sum of d + 1 terms with an error of at most
    (d + 8) 2⁻²⁴ (|x| + |q|)²; it suffers from cancellation for x near q. For every row that may be among the k nearest
    within this bound, |x − q| is computed again in double precision.
    """

    def __init__(self, dimension: int, capacity: int = 16) -> None:
        self.dimension = dimension
        self._columns = PlaceColumns(dimension, capacity)
        self._squared_norms = np.empty(capacity, np.float32)
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
        """Overwrite known places and add new ones; RefusedInput as `check`."""
        self.check(table)
        before = len(self)
        _, known = self._columns.find(table.place_ids)
        self._columns.upsert(table)
        rows, _ = self._columns.find(table.place_ids)
        if not np.all(rows[~known] >= before):
            self._update_squared_norms(slice(0, len(self)))
        elif known.any():
            self._update_squared_norms(rows)
        else:
            self._update_squared_norms(slice(before, len(self)))

    def remove(self, place_ids: NDArray[np.int64]) -> None:
        """Remove places; unknown ids are ignored."""
        if self._columns.find(place_ids)[1].any():
            self._columns.remove(place_ids)
            self._update_squared_norms(slice(0, len(self)))

    def search(self, mean: NDArray[np.float32], k: int, exclude: NDArray[np.int64] | None = None) -> list[Candidate]:
        """The k places nearest to `mean` (d,), nearest first; of equal distances the lower id first.

        Fewer than k if the index has fewer. `exclude` (M,) int64 are ids that are not searched. Distances are exact,
        rounded to single precision.
        """
        return self.around(mean, exclude).nearest(k)

    def around(self, mean: NDArray[np.float32], exclude: NDArray[np.int64] | None = None) -> PlaceSearch:
        """The places by their distance to `mean` (d,), for several searches; `exclude` as in `search`."""
        rows, known = self._columns.find(np.empty(0, np.int64) if exclude is None else exclude)
        return PlaceSearch(self, np.asarray(mean, np.float32), np.unique(rows[known]))

    def scans(self) -> list[ScanKey]:
        """The scans that the places hold, in ascending order of id."""
        return self._columns.table.scans()

    def mean_of(self, place_id: int) -> NDArray[np.float32] | None:
        """(d,) a copy of the mean of a place; None if it is not in the index."""
        rows, known = self._columns.find(np.array([place_id], np.int64))
        return self._columns.table.means[rows[0]].copy() if known[0] else None

    def scan_of(self, place_id: int) -> ScanKey | None:
        """The scan that a place holds; None if it is not in the index."""
        rows, known = self._columns.find(np.array([place_id], np.int64))
        table = self._columns.table
        return ScanKey(int(table.session_ids[rows[0]]), int(table.stamps_ns[rows[0]])) if known[0] else None

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """(N, 3) float64 in the ``map`` frame, in ascending order of id; a view, valid until the next change."""
        return self._columns.table.positions_m

    def rows_within(self, position_m: NDArray[np.float64], radius_m: float) -> NDArray[np.bool_]:
        """(N,) whether each place is within `radius_m` of (x, y) on the ground."""
        x_m, y_m = self._columns.table.positions_m[:, 0], self._columns.table.positions_m[:, 1]
        within: NDArray[np.bool_] = np.square(x_m - position_m[0]) + np.square(y_m - position_m[1]) <= radius_m**2
        return within

    def search_many(
        self, queries: NDArray[np.float32], k: int, exclude: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """`search` for many means at once, by matrix products: the same places and the same distances.

        Args:
            queries: (Q, d) finite means.
            k: number of places for each query.
            exclude: (Q, N) bool, True where a place is not searched for a query; None excludes nothing.

        Returns:
            (Q, min(k, N)) int rows of the places, indices into `place_ids`, nearest first, of equal distances the
            lower id first; and (Q, min(k, N)) float32 distances, exact but for rounding. Where fewer than k places are
            not excluded, the last distances are infinite and their rows have no meaning.
        """
        queries, k = np.asarray(queries, np.float32), min(k, len(self))
        rows, distances = np.zeros((len(queries), k), np.intp), np.full((len(queries), k), np.inf, np.float32)
        step = max(min(_BLOCK, 2**22 // max(len(self), 1)), 1)
        for start in range(0, len(queries) if k else 0, step):
            part = slice(start, start + step)
            squares = self.squared_distances(queries[part])
            if exclude is not None:
                squares[exclude[part]] = np.inf
            rows[part], distances[part] = self._nearest(queries[part], squares, k)
        return rows, distances

    def squared_distances(self, queries: NDArray[np.float32]) -> NDArray[np.float64]:
        """(Q, N) squared distances |x|² + |q|² − 2 x·q of (Q, d) means to every place, in ascending order of id.

        In double precision, with an error of at most (d + 8) 2⁻⁵³ (|x| + |q|)²: a zero may be slightly negative.
        """
        doubles, means = np.asarray(queries, np.float64), self._columns.table.means
        squares = np.empty((len(doubles), len(means)), np.float64)
        query_norms = np.einsum('qd,qd->q', doubles, doubles)
        for start in range(0, len(means), _BLOCK):
            block = means[start : start + _BLOCK].astype(np.float64)
            part = doubles @ (-2.0 * block.T)
            part += np.einsum('nd,nd->n', block, block)
            part += query_norms[:, np.newaxis]
            squares[:, start : start + _BLOCK] = part
        return squares

    def _nearest(
        self, queries: NDArray[np.float32], squares: NDArray[np.float64], k: int
    ) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """(Q, k) rows and exact distances of the nearest places, by squared distances (Q, N) with rounding errors."""
        rows = squares.argmin(axis=1)[:, np.newaxis] if k == 1 else np.argpartition(squares, k - 1, axis=1)[:, :k]
        limits = self._limits(queries, np.take_along_axis(squares, rows, 1).max(axis=1))
        distances = np.empty(rows.shape, np.float32)
        step = max(self._rows_at_once // k, 1)
        for start in range(0, len(rows), step):
            part = slice(start, start + step)
            pairs = self._distances(np.repeat(queries[part], k, axis=0), rows[part].reshape(-1))
            distances[part] = pairs.reshape(-1, k)
        order = np.lexsort((rows, distances), axis=1)
        rows, distances = np.take_along_axis(rows, order, 1), np.take_along_axis(distances, order, 1)
        # Where more than k are within the limit, argpartition chose any k of them.
        within = squares <= limits[:, np.newaxis]
        for query in np.flatnonzero(np.count_nonzero(within, axis=1) != k).tolist():
            found, exact = self._ranked(queries[query], np.flatnonzero(within[query]), k)
            rows[query, : len(found)], distances[query, : len(found)] = found, exact
            distances[query, len(found) :] = np.inf
        return rows, distances

    def _limits(self, queries: NDArray[np.float32], squares: NDArray[np.float64]) -> NDArray[np.float64]:
        """(Q,) squared distances up to which a place may be as near as the k-th, computed as `squares` (Q,)."""
        norms = np.sqrt(np.einsum('qd,qd->q', queries, queries, dtype=np.float64))
        error = (self.dimension + 8) * 2.0**-53 * (norms + 1.001 * np.sqrt(self._largest_squared_norm())) ** 2
        with np.errstate(over='ignore'):
            rounded = np.sqrt(np.maximum(squares, 0.0) + error).astype(np.float32)
        # Distances that round to the same single-precision number are equal.
        beyond = np.nextafter(rounded, np.float32(np.inf)).astype(np.float64)
        # Never infinite: excluded places have an infinite distance.
        limits: NDArray[np.float64] = np.minimum(beyond**2 + error, np.finfo(np.float64).max)
        return limits

    def _ranked(
        self, query: NDArray[np.float32], rows: NDArray[np.intp], k: int
    ) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """The k nearest of these ascending rows, and their distances; of equal distances the first row."""
        distances = self._distances(query, rows)
        nearest = np.argsort(distances, kind='stable')[:k]
        return rows[nearest], distances[nearest]

    def _scores(self, query: NDArray[np.float32]) -> tuple[NDArray[np.float32], float] | None:
        """(N,) |x|² − 2 x·q, and the bound on their error; None where single precision could overflow."""
        largest = (np.sqrt(self._largest_squared_norm()) + np.linalg.norm(query.astype(np.float64))) ** 2
        if not largest < _LARGEST_SQUARE:
            return None
        scores = self._columns.table.means @ (np.float32(-2.0) * query)
        scores += self._squared_norms[: len(self)]
        return scores, (self.dimension + 8) * (_UNIT_ROUNDOFF * float(largest) + _TINY)

    def _distances(self, queries: NDArray[np.float32], rows: NDArray[np.intp]) -> NDArray[np.float32]:
        """(M,) exact distances of (M,) rows to one query (d,), or of each row to its own query (M, d)."""
        distances = np.empty(len(rows), np.float32)
        for start in range(0, len(rows), self._rows_at_once):
            part = slice(start, start + self._rows_at_once)
            offsets = self._columns.table.means[rows[part]].astype(np.float64)
            offsets -= queries if queries.ndim == 1 else queries[part]
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
            table.yaw_sds_rad[rows].tolist(),
            strict=True,
        )
        return [
            Candidate(place_id, distance, uncertainty, Pose(x_m, y_m, z_m, yaw_rad, sd_rad))
            for place_id, distance, uncertainty, (x_m, y_m, z_m), yaw_rad, sd_rad in places
        ]

    @property
    def _rows_at_once(self) -> int:
        return max(_DOUBLES_AT_ONCE // max(self.dimension, 1), 1)

    def _largest_squared_norm(self) -> float:
        """The largest squared norm, computed once after each change."""
        if self._largest is None:
            self._largest = float(self._squared_norms[: len(self)].max())
        return self._largest

    def _update_squared_norms(self, rows: NDArray[np.intp] | slice) -> None:
        """Compute the squared norms of changed rows; they are infinite on overflow."""
        self._largest = None
        if len(self) > len(self._squared_norms):
            grown = np.empty(max(len(self), 2 * len(self._squared_norms)), np.float32)
            grown[: len(self._squared_norms)] = self._squared_norms
            self._squared_norms = grown
        stored = self._columns.table.means
        first, end = (rows.start, rows.stop) if isinstance(rows, slice) else (0, len(rows))
        for start in range(first, end, self._rows_at_once):
            part = slice(start, min(start + self._rows_at_once, end))
            some = part if isinstance(rows, slice) else rows[part]
            means = stored[some].astype(np.float64)
            with np.errstate(over='ignore'):
                self._squared_norms[some] = np.einsum('ij,ij->i', means, means)

    def check(self, table: PlaceTable) -> None:
        """RefusedInput (`wrong_dimension`, `invalid_place`) if `upsert` would refuse these places."""
        if table.means.shape != (len(table), self.dimension):
            raise RefusedInput(
                'wrong_dimension',
                f'places of dimension {table.means.shape[-1]} refused: the map has dimension {self.dimension}',
            )
        if problem := place_problem(table):
            raise RefusedInput('invalid_place', f'{len(table)} places refused: {problem}')


class PlaceSearch:
    """The places of an index by their distance to one mean, computed once; valid until the index changes."""

    def __init__(self, index: PlaceIndex, query: NDArray[np.float32], excluded: NDArray[np.intp]) -> None:
        self._index, self._query, self._excluded = index, query, excluded
        self._scored = index._scores(query) if len(index) > len(excluded) else None

    def nearest(self, k: int) -> list[Candidate]:
        """As `PlaceIndex.search`."""
        k = min(k, len(self._index) - len(self._excluded))
        if k <= 0:
            return []
        return self._index._candidates(*self._index._ranked(self._query, self._shortlist(k, self._excluded), k))

    def distance_apart(self, position_m: NDArray[np.float64], radius_m: float) -> float:
        """Distance, in embedding space, of the nearest place farther than `radius_m` from (x, y); infinite if none."""
        near = np.flatnonzero(self._index.rows_within(position_m, radius_m))
        excluded = np.union1d(near, self._excluded)
        if len(excluded) == len(self._index):
            return math.inf
        return float(self._index._ranked(self._query, self._shortlist(1, excluded), 1)[1][0])

    def within(self, position_m: NDArray[np.float64], radius_m: float) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """(M,) ascending ids of the places within `radius_m` of (x, y), and their distances in embedding space."""
        rows = np.setdiff1d(np.flatnonzero(self._index.rows_within(position_m, radius_m)), self._excluded)
        return self._index.place_ids[rows], self._index._distances(self._query, rows)

    def _shortlist(self, k: int, excluded: NDArray[np.intp]) -> NDArray[np.intp]:
        """Ascending rows among which the k nearest are for certain."""
        if self._scored is None:
            return np.setdiff1d(np.arange(len(self._index)), excluded)
        scores, error = self._scored
        if len(excluded):
            scores = scores.copy()
            scores[excluded] = np.inf
        return _rows_within_margin(scores, k, 2.0 * error)
