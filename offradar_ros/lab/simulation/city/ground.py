"""Which ground of a city is road, and which is free."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CELL_M = 0.5
_KERB_M = 1.0
_DRIVEN_M = 3.5
"""Width of the lanes on each side of a street's centre line; cars park outside them."""


class Ground:
    """Half-metre cells between two corners of the city; what lies outside is never free."""

    def __init__(self, low_m: Array, high_m: Array) -> None:
        self._low_m = low_m
        width, height = np.ceil((high_m - low_m) / _CELL_M).astype(int)
        self._taken, self._road, self._driven = (np.zeros((height, width), np.uint8) for _ in range(3))

    def pave(self, line_m: Array, half_width_m: float) -> None:
        """Mark a street, (M, 2) metres of its centre line, and its kerbs as taken."""
        cells = np.rint((line_m - self._low_m) / _CELL_M).astype(np.int32)
        for mask, half_m in (
            (self._taken, half_width_m + _KERB_M),
            (self._road, half_width_m - _CELL_M),
            (self._driven, _DRIVEN_M),
        ):
            cv2.polylines(mask, [cells], isClosed=False, color=1, thickness=round(2 * half_m / _CELL_M))

    def claim(self, polygon_m: Array, overlap: float = 0.0) -> bool:
        """Mark a convex polygon, (K, 2) metres, as taken if it is off the road and at most `overlap` of it is taken.

        Returns whether it was free.
        """
        cells = np.rint((polygon_m - self._low_m) / _CELL_M).astype(np.int32)
        (left, bottom), (right, top) = cells.min(axis=0), cells.max(axis=0)
        if left < 0 or bottom < 0 or right >= self._taken.shape[1] or top >= self._taken.shape[0]:
            return False
        window = slice(bottom, top + 1), slice(left, right + 1)
        part = self._taken[window]
        wanted = np.zeros_like(part)
        cv2.fillConvexPoly(wanted, cells - (left, bottom), 1)
        if np.any(self._road[window] & wanted) or np.sum(part & wanted) > overlap * np.sum(wanted):
            return False
        part |= wanted
        return True

    def points_off_the_road(self, points_m: Array) -> Mask:
        """(N,) whether each of (N, 2) points is on no street."""
        return ~self._at(self._road, points_m)

    def walls_off_the_road(self, walls_m: Array) -> Mask:
        """(W,) whether each of (W, 2, 2) walls is on no street along its whole length."""
        steps = max(2, int(np.hypot(*(walls_m[:, 1] - walls_m[:, 0]).T).max(initial=0.0)) + 1)
        off = np.ones(len(walls_m), np.bool_)
        for share in np.linspace(0.0, 1.0, steps):
            off &= self.points_off_the_road((1.0 - share) * walls_m[:, 0] + share * walls_m[:, 1])
        return off

    def cars_off_the_lanes(self, points_m: Array) -> Mask:
        """(N,) whether each of (N, 2) parked cars is outside of all lanes."""
        return ~self._at(self._driven, points_m)

    def _at(self, mask: NDArray[np.uint8], points_m: Array) -> Mask:
        cells = np.rint((points_m - self._low_m) / _CELL_M).astype(np.intp)
        inside = np.all((cells >= 0) & (cells < mask.shape[::-1]), axis=1)
        found = np.zeros(len(points_m), np.bool_)
        found[inside] = mask[cells[inside, 1], cells[inside, 0]] > 0
        return found
