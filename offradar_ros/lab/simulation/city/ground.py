"""Which ground of a city is road, and which is free."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.parked_cars import PLACE_M
from offradar_ros.lab.simulation.road import Road

Array = NDArray[np.float64]
Cells = NDArray[np.int32]
Mask = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

_CELL_M = 0.5
_KERB_M = 1.0
_CROSSING_M = 6.0
"""No car parks on a street within this distance of another street."""

_AROUND = np.ones((3, 3), np.uint8)
_PLACE = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * PLACE_M


class Ground:
    """Half-metre cells between two corners of the city; what lies outside is never free."""

    def __init__(self, low_m: Array, high_m: Array) -> None:
        self._low_m = low_m
        width, height = np.ceil((high_m - low_m) / _CELL_M).astype(int)
        # Not free; paved, and so far within the kerbs that no object stands there; paved; paved by two streets.
        self._taken, self._kept, self._paved, self._shared = (np.zeros((height, width), np.uint8) for _ in range(4))

    def pave(self, line_m: Array, half_width_m: float) -> None:
        """Mark a street, (M, 2) metres of its centre line, and its kerbs as taken."""

        def strip(extra_m: float) -> Callable[[Bytes, Cells], object]:
            thickness = round(2 * (half_width_m + extra_m) / _CELL_M)
            return lambda mask, cells: cv2.polylines(mask, [cells], isClosed=False, color=1, thickness=thickness)

        self._pave(line_m, half_width_m, strip)

    def pave_circle(self, centre_m: Array, radius_m: float) -> None:
        """Mark the circle of a roundabout, and its kerb."""

        def circle(extra_m: float) -> Callable[[Bytes, Cells], object]:
            radius = round((radius_m + extra_m) / _CELL_M)
            return lambda mask, cells: cv2.circle(mask, cells[0].tolist(), radius, color=1, thickness=-1)

        self._pave(centre_m[None], radius_m, circle)

    def _pave(self, line_m: Array, reach_m: float, shape: Callable[[float], Callable[[Bytes, Cells], object]]) -> None:
        cells = self._cells(line_m)
        shape(_KERB_M)(self._taken, cells)
        shape(-_CELL_M)(self._kept, cells)
        reach = round(reach_m / _CELL_M) + 2
        window, cells = self._window(cells, reach)
        paved = np.zeros_like(self._paved[window])
        shape(0.0)(paved, cells)
        self._shared[window] |= self._paved[window] & paved
        self._paved[window] |= paved

    def raise_strip(self, line_m: Array, half_width_m: float) -> None:
        """Make a median of a part of a road: nobody drives there, and objects stand on it."""
        cells, thickness = self._cells(line_m), round(2 * half_width_m / _CELL_M)
        for mask in (self._kept, self._paved):
            cv2.polylines(mask, [cells], isClosed=False, color=0, thickness=thickness)

    def raise_circle(self, centre_m: Array, radius_m: float) -> None:
        """Make an island of a part of a road."""
        for mask in (self._kept, self._paved):
            cv2.circle(mask, self._cells(centre_m[None])[0].tolist(), round(radius_m / _CELL_M), color=0, thickness=-1)

    def claim(self, polygon_m: Array, overlap: float = 0.0) -> bool:
        """Mark a convex polygon, (K, 2) metres, as taken if it is off the road and at most `overlap` of it is taken.

        Returns whether it was free.
        """
        cells = self._cells(polygon_m)
        (left, bottom), (right, top) = cells.min(axis=0), cells.max(axis=0)
        if left < 0 or bottom < 0 or right >= self._taken.shape[1] or top >= self._taken.shape[0]:
            return False
        window, cells = self._window(cells, 1)
        part = self._taken[window]
        wanted = np.zeros_like(part)
        cv2.fillConvexPoly(wanted, cells, 1)
        # Its sides may pass through cells next to those that are filled.
        if np.any(self._kept[window] & cv2.dilate(wanted, _AROUND)) or np.sum(part & wanted) > overlap * np.sum(wanted):
            return False
        part |= wanted
        return True

    def points_off_the_road(self, points_m: Array) -> Mask:
        """(N,) whether each of (N, 2) points is on no street."""
        return ~self._at(self._kept, points_m)

    def walls_off_the_road(self, walls_m: Array) -> Mask:
        """(W,) whether each of (W, 2, 2) walls is on no street along its whole length."""
        steps = max(2, int(np.hypot(*(walls_m[:, 1] - walls_m[:, 0]).T).max(initial=0.0)) + 1)
        off = np.ones(len(walls_m), np.bool_)
        for share in np.linspace(0.0, 1.0, steps):
            off &= self.points_off_the_road((1.0 - share) * walls_m[:, 0] + share * walls_m[:, 1])
        return off

    def places_on_one_street(self, places: Array) -> Mask:
        """(N,) whether each of (N, 3) parking places is away from all crossings."""
        size = 2 * round(_CROSSING_M / _CELL_M) + 1
        return self._off(np.asarray(cv2.dilate(self._shared, np.ones((size, size), np.uint8)), np.uint8), places)

    def places_off_the_road(self, places: Array) -> Mask:
        """(N,) whether each of (N, 3) parking places is on no street."""
        return self._off(self._paved, places)

    def _off(self, mask: Bytes, places: Array) -> Mask:
        corners = _corners(places)
        return np.asarray(~self._at(mask, corners.reshape(-1, 2)).reshape(-1, len(_PLACE)).any(axis=1))

    def road(self, parking: Array) -> Road:
        """What is paved, without (N, 3) parking places."""
        free = self._paved.copy()
        for cells in np.rint((_corners(parking) - self._low_m) / _CELL_M).astype(np.int32):
            cv2.fillConvexPoly(free, cells, 0)
        return Road(self._low_m, _CELL_M, free)

    def _cells(self, points_m: Array) -> Cells:
        return np.asarray(np.rint((points_m - self._low_m) / _CELL_M), np.int32)

    def _window(self, cells: Cells, around: int) -> tuple[tuple[slice, slice], Cells]:
        """Rows and columns around (M, 2) cells, and these cells within them."""
        left, bottom = np.maximum(cells.min(axis=0) - around, 0)
        right, top = cells.max(axis=0) + around + 1
        return (slice(bottom, top), slice(left, right)), np.asarray(cells - (left, bottom), np.int32)

    def _at(self, mask: Bytes, points_m: Array) -> Mask:
        cells = np.rint((points_m - self._low_m) / _CELL_M).astype(np.intp)
        inside = np.all((cells >= 0) & (cells < mask.shape[::-1]), axis=1)
        found = np.zeros(len(points_m), np.bool_)
        found[inside] = mask[cells[inside, 1], cells[inside, 0]] > 0
        return found


def _corners(places: Array) -> Array:
    """(N, 4, 2) corners of (N, 3) parking places."""
    cosine, sine = np.cos(places[:, 2:]), np.sin(places[:, 2:])
    x, y = _PLACE.T
    return np.stack([places[:, :1] + cosine * x - sine * y, places[:, 1:2] + sine * x + cosine * y], axis=-1)
