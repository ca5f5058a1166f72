"""Which places may lie near a position, without looking at all of them."""

from __future__ import annotations

import math

_STRIDE = 2**32
"""Columns of cells apart in a key. Keys may coincide for cells that far apart, which only adds candidates."""


class PositionGrid:
    """Indices hashed by the square cell that their position lies in; positions are metres east and north."""

    def __init__(self, cell_m: float) -> None:
        self._cell_m = cell_m
        self._cells: dict[int, list[int]] = {}

    def _cell(self, value_m: float) -> int:
        return math.floor(value_m / self._cell_m)

    def _key(self, x_m: float, y_m: float) -> int:
        return self._cell(x_m) * _STRIDE + self._cell(y_m)

    def add(self, index: int, x_m: float, y_m: float) -> None:
        """Put `index` at a finite position."""
        self._cells.setdefault(self._key(x_m, y_m), []).append(index)

    def remove(self, index: int, x_m: float, y_m: float) -> None:
        """Take `index` away from the position it was added at."""
        key = self._key(x_m, y_m)
        self._cells[key].remove(index)
        if not self._cells[key]:
            del self._cells[key]

    def near(self, x_m: float, y_m: float, radius_m: float) -> list[int]:
        """Every index within `radius_m`, and some others of the same cells, in no order.

        The cells run from that of x − r to that of x + r. Subtraction, division and floor are monotonic in floating
        point too, so that no index at a computed distance below r is missed at a cell's edge.
        """
        columns = range(self._cell(x_m - radius_m), self._cell(x_m + radius_m) + 1)
        rows = range(self._cell(y_m - radius_m), self._cell(y_m + radius_m) + 1)
        return [index for column in columns for row in rows for index in self._cells.get(column * _STRIDE + row, ())]
