"""Scans subsampled by distance driven."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MAP_SPACING_M = 5.0
"""Metres driven between two places of a map, as in the protocols."""


def subsample_by_distance(driven_m: NDArray[np.float64], spacing_m: float) -> NDArray[np.intp]:
    """Indices of the first scan in each stretch of `spacing_m`; (N,) `driven_m` are metres driven, never decreasing.

    The mean spacing is `spacing_m` wherever scans are nearer to each other than that. To keep a scan whenever the last
    kept one is `spacing_m` away would give 6 m instead of 5 m where scans are 2 m apart. A spacing of 0 keeps all.
    """
    if spacing_m == 0.0:
        return np.arange(len(driven_m))
    cells = np.floor(driven_m / spacing_m + 1e-9).astype(np.int64)
    return np.flatnonzero(np.diff(cells, prepend=cells[:1] - 1) > 0)


def path_length_m(positions_m: NDArray[np.float64], step_m: float = 1.0) -> NDArray[np.float64]:
    """(N,) metres driven up to each of (N, 2) positions, counted in steps of at least `step_m`.

    The positions of a vehicle that stands still wander by decimetres, which would add up.
    """
    driven_m = np.zeros(len(positions_m))
    anchor, length_m = positions_m[:1], 0.0
    for row in range(1, len(positions_m)):
        step = float(np.hypot(*(positions_m[row] - anchor[0])))
        if step >= step_m:
            length_m += step
            anchor = positions_m[row : row + 1]
        driven_m[row] = length_m
    return driven_m
