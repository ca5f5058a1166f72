"""What a radar sees during one scan."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

THROUGH = 1.0 / 12.0
"""Share of the power that passes a wall, there and back, unless the wall says otherwise."""


@dataclasses.dataclass(frozen=True, eq=False)
class Reflectors:
    """What there is to see during one scan, in the world's frame.

    Attributes:
        walls_m: (W, 2, 2) float64, ends of each wall, metres.
        wall_powers: (W,) float64, linear, of a return from 10 m face on, with the receiver's noise at 1.
        wall_through: (W,) float64, share of the power that passes the wall, there and back; 0 hides everything behind.
        scatterers_m: (S, 2) float64, metres.
        scatterer_powers: (S,) float64, as `wall_powers`.
    """

    walls_m: Array
    wall_powers: Array
    wall_through: Array
    scatterers_m: Array
    scatterer_powers: Array

    def within(self, centre_m: Array, range_m: float) -> Reflectors:
        """Those that may be nearer than `range_m`: all that come into the box of that half size round the centre."""
        low, high = centre_m - range_m, centre_m + range_m
        starts, ends = self.walls_m[:, 0], self.walls_m[:, 1]
        walls = np.all((np.minimum(starts, ends) < high) & (np.maximum(starts, ends) > low), axis=1)
        scatterers = np.all((self.scatterers_m < high) & (self.scatterers_m > low), axis=1)
        return Reflectors(
            self.walls_m[walls],
            self.wall_powers[walls],
            self.wall_through[walls],
            self.scatterers_m[scatterers],
            self.scatterer_powers[scatterers],
        )
