"""A growing table of places in ascending order of id."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import Place, PlaceTable, Pose

Rows = NDArray[np.intp]


def take_rows(table: PlaceTable, rows: Rows | slice) -> PlaceTable:
    """Some rows of a table: copies for an index array, views for a slice."""
    return PlaceTable(*(getattr(table, field.name)[rows] for field in dataclasses.fields(table)))


def place_of(table: PlaceTable, row: int) -> Place:
    """One row as a `Place`; the mean is a copy."""
    x_m, y_m, z_m = (float(v) for v in table.positions_m[row])
    return Place(
        place_id=int(table.place_ids[row]),
        session_id=int(table.session_ids[row]),
        stamp_ns=int(table.stamps_ns[row]),
        pose=Pose(x_m, y_m, z_m, float(table.yaws_rad[row]), float(table.yaw_sds_rad[row])),
        uncertainty=float(table.uncertainties[row]),
        mean=table.means[row].copy(),
    )


def capacity_for(places: int) -> int:
    """Capacity for a stored map and new places of a drive: the first new place should not copy the whole map."""
    return places + max(places // 4, 16)


def _allocate(capacity: int, dimension: int) -> PlaceTable:
    return PlaceTable(
        place_ids=np.empty(capacity, np.int64),
        session_ids=np.empty(capacity, np.int32),
        stamps_ns=np.empty(capacity, np.int64),
        positions_m=np.empty((capacity, 3), np.float64),
        yaws_rad=np.empty(capacity, np.float64),
        yaw_sds_rad=np.empty(capacity, np.float32),
        uncertainties=np.empty(capacity, np.float32),
        means=np.empty((capacity, dimension), np.float32),
    )


class PlaceColumns:
    """A `PlaceTable` with row updates in microseconds; its capacity doubles when it is full.

    Rows are always in ascending order of place id. Unused capacity takes address space, not memory.
    """

    def __init__(self, dimension: int, capacity: int = 16) -> None:
        self.dimension = dimension
        self._memory = _allocate(capacity, dimension)
        self._resize(0)

    def __len__(self) -> int:
        return self._size

    @property
    def table(self) -> PlaceTable:
        """Views of the rows in use, valid until the next change."""
        return self._table

    def _resize(self, size: int) -> None:
        self._size = size
        self._table = take_rows(self._memory, slice(0, size))

    def find(self, place_ids: NDArray[np.int64]) -> tuple[Rows, NDArray[np.bool_]]:
        """(N,) rows where these (N,) ids are or would be inserted, and (N,) bool: whether they are in the table."""
        known = self._memory.place_ids[: self._size]
        rows = np.searchsorted(known, place_ids)
        inside = rows < self._size
        return rows, inside & (known[np.where(inside, rows, 0)] == place_ids) if self._size else inside

    def upsert(self, table: PlaceTable) -> None:
        """Overwrite the rows with known ids and insert the others; if an id is repeated, its last row counts."""
        table = _unique_ids(table)
        rows, known = self.find(table.place_ids)
        self._write(rows[known], take_rows(table, np.flatnonzero(known)))
        new = take_rows(table, np.flatnonzero(~known))
        if not len(new):
            return
        start = self._size
        self._reserve(start + len(new))
        self._resize(start + len(new))
        self._write(slice(start, self._size), new)
        if start and new.place_ids[0] < self._memory.place_ids[start - 1]:
            order = np.argsort(self._memory.place_ids[: self._size])
            self._write(slice(0, self._size), take_rows(self._memory, order))

    def remove(self, place_ids: NDArray[np.int64]) -> None:
        """Remove rows; unknown ids are ignored."""
        rows, known = self.find(np.asarray(place_ids, np.int64))
        keep = np.ones(self._size, np.bool_)
        keep[rows[known]] = False
        first = int(np.argmin(keep)) if not keep.all() else self._size
        kept = first + np.flatnonzero(keep[first:])
        self._write(slice(first, first + len(kept)), take_rows(self._memory, kept))
        self._resize(first + len(kept))

    def _write(self, rows: Rows | slice, table: PlaceTable) -> None:
        for field in dataclasses.fields(table):
            getattr(self._memory, field.name)[rows] = getattr(table, field.name)

    def _reserve(self, size: int) -> None:
        capacity = len(self._memory)
        if size > capacity:
            full = self._memory
            self._memory = _allocate(max(size, 2 * capacity), self.dimension)
            self._write(slice(0, capacity), full)


def _unique_ids(table: PlaceTable) -> PlaceTable:
    """Rows in ascending order of id, the last row of each id."""
    ids = table.place_ids
    if len(ids) < 2 or bool(np.all(ids[1:] > ids[:-1])):
        return table
    _, last = np.unique(ids[::-1], return_index=True)
    return take_rows(table, len(ids) - 1 - last)
