"""A spatial hash: candidates near a position, without a look at every place."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_STRIDE = 2**29
"""Difference of the keys of two neighbouring columns of cells. Cells this far apart may share a key, which only adds
candidates.

The keys of all positions on Earth (1e8 m) in cells of a centimetre or more fit 64 bits.
"""

_MAX_CELL = 2.0**63 / (_STRIDE + 1)
"""Keys of cell indices below this fit 64 bits; beyond it, keys are Python integers."""


class PositionGrid:
    """Indices hashed by the square cell that their position lies in; positions are metres east and north."""

    def __init__(self, cell_m: float) -> None:
        self._cell_m = cell_m
        # Tuples of numbers: the garbage collector stops tracking them, but would visit a million lists again and again.
        self._cells: dict[int, tuple[int, ...]] = {}

    def _cell(self, value_m: float) -> int:
        return math.floor(value_m / self._cell_m)

    def _key(self, x_m: float, y_m: float) -> int:
        return self._cell(x_m) * _STRIDE + self._cell(y_m)

    def add(self, index: int, x_m: float, y_m: float) -> None:
        """Add `index` at a finite position."""
        key = self._key(x_m, y_m)
        self._cells[key] = (*self._cells.get(key, ()), index)

    def fill(self, positions_m: NDArray[np.float64]) -> None:
        """Replace all content by the indices 0 … N − 1 at (N, 2) finite positions."""
        cells = np.floor(positions_m / self._cell_m)
        if np.abs(cells).max(initial=0.0) >= _MAX_CELL:
            self._cells = {}
            for index, (x_m, y_m) in enumerate(positions_m.tolist()):
                self.add(index, x_m, y_m)
            return
        cells = cells.astype(np.int64)
        keys = cells[:, 0] * _STRIDE + cells[:, 1]
        order = np.argsort(keys, kind='stable')
        found, starts, counts = np.unique(keys[order], return_index=True, return_counts=True)
        alone = counts == 1
        self._cells = dict(zip(found[alone].tolist(), zip(order[starts[alone]].tolist(), strict=True), strict=True))
        for key, start, count in zip(found[~alone].tolist(), starts[~alone], counts[~alone], strict=True):
            self._cells[key] = tuple(order[start : start + count].tolist())

    def remove(self, index: int, x_m: float, y_m: float) -> None:
        """Remove `index` from the position at which it was added."""
        key = self._key(x_m, y_m)
        left = tuple(other for other in self._cells[key] if other != index)
        if left:
            self._cells[key] = left
        else:
            del self._cells[key]

    def near(self, x_m: float, y_m: float, radius_m: float) -> list[int]:
        """Every index within `radius_m`, and others of the same cells, unordered.

        The cells are those from x − r to x + r, and so in y. Subtraction, division and floor are monotonic in floating
        point too, so that no index at a computed distance below r is missed at the edge of a cell.
        """
        columns = range(self._cell(x_m - radius_m), self._cell(x_m + radius_m) + 1)
        rows = range(self._cell(y_m - radius_m), self._cell(y_m + radius_m) + 1)
        return [index for column in columns for row in rows for index in self._cells.get(column * _STRIDE + row, ())]
