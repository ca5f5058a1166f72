"""Where in a world a vehicle can drive."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CLEARANCE_M = 1.9
"""From the middle of a vehicle to kerbs, islands and parked cars: half of a lorry, 0.3 m of wander, and a margin."""


class Road:
    """Square cells of a world, from a corner on.

    Attributes:
        free: (rows, columns) bool, whether the middle of a vehicle can be there; rows go north, columns east.
        extent_m: west, east, south and north edge of these cells.
    """

    def __init__(self, low_m: Array, cell_m: float, paved: NDArray[np.uint8]) -> None:
        """`paved` is (rows, columns), from the (2,) corner `low_m` to the north and east; 0 where nothing drives."""
        self._low_m, self._cell_m = low_m, cell_m
        # Distances are between the middles of cells: the edge of the road is half a cell nearer.
        to_edge = cv2.distanceTransform(paved, cv2.DIST_L2, 5)
        self.free: Mask = to_edge * cell_m > CLEARANCE_M + cell_m / 2
        west, south = (low_m - cell_m / 2).tolist()
        self.extent_m = (west, west + cell_m * paved.shape[1], south, south + cell_m * paved.shape[0])

    def is_free(self, points_m: Array) -> Mask:
        """(…,) whether the middle of a vehicle can be at each of (…, 2) points."""
        columns, rows = np.moveaxis(np.rint((points_m - self._low_m) / self._cell_m).astype(np.intp), -1, 0)
        height, width = self.free.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return np.asarray(self.free[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)] & inside)
