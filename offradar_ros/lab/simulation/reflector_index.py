"""A spatial index of reflectors: those near the radar, without a search of the whole world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import Reflectors

Array = NDArray[np.float64]

_CELL_M = 25.0
_STRIDE = 2**20
"""Cells of a column have consecutive keys; keys of neighbouring columns differ by this."""


class ReflectorIndex:
    """Reflectors sorted by square cell; a wall lies in the cell of its middle."""

    def __init__(self, reflectors: Reflectors) -> None:
        middles = reflectors.walls_m.mean(axis=1)
        lengths = np.hypot(*(reflectors.walls_m[:, 1] - reflectors.walls_m[:, 0]).T)
        self._half_length_m = float(lengths.max(initial=0.0)) / 2
        walls, points = _keys(middles), _keys(reflectors.scatterers_m)
        by_wall, by_point = np.argsort(walls, kind='stable'), np.argsort(points, kind='stable')
        self._walls, self._points = walls[by_wall], points[by_point]
        self._sorted = reflectors.select(by_wall, by_point)

    def near(self, centre_m: Array, range_m: float) -> Reflectors:
        """All within `range_m` of a (2,) point, and some that are further away."""
        walls = _slices(self._walls, centre_m, range_m + self._half_length_m)
        points = _slices(self._points, centre_m, range_m)
        return self._sorted.select(walls, points)


def _keys(points_m: Array) -> NDArray[np.int64]:
    cells = np.floor(points_m / _CELL_M).astype(np.int64)
    return np.asarray(cells[:, 0] * _STRIDE + cells[:, 1])


def _slices(keys: NDArray[np.int64], centre_m: Array, range_m: float) -> NDArray[np.intp]:
    low, high = (np.floor((centre_m + side * range_m) / _CELL_M).astype(np.int64) for side in (-1, 1))
    columns = np.arange(low[0], high[0] + 1) * _STRIDE
    starts, ends = np.searchsorted(keys, columns + low[1]), np.searchsorted(keys, columns + high[1], side='right')
    parts = [np.arange(start, end) for start, end in zip(starts.tolist(), ends.tolist(), strict=True)]
    return np.concatenate(parts)
