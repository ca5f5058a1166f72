"""Walls and scatterers: what returns the signal of a radar."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.bool_] | NDArray[np.intp]


@dataclasses.dataclass(frozen=True, eq=False)
class Reflectors:
    """W walls and S scatterers, in the frame of the world.

    Attributes:
        walls_m: (W, 2, 2) float64, x and y of the two ends of each wall, metres.
        wall_powers: (W,) float64, linear, of a return from 10 m at normal incidence, with the receiver's noise at 1.
        wall_transmission: (W,) float64, share of the power that passes the wall in both directions; 0 hides all behind.
        scatterers_m: (S, 2) float64, metres.
        scatterer_powers: (S,) float64, as `wall_powers`.
    """

    walls_m: Array
    wall_powers: Array
    wall_transmission: Array
    scatterers_m: Array
    scatterer_powers: Array

    def select(self, walls: Index, scatterers: Index) -> Reflectors:
        """The walls and scatterers at these indices, or where these masks are true."""
        return Reflectors(
            self.walls_m[walls],
            self.wall_powers[walls],
            self.wall_transmission[walls],
            self.scatterers_m[scatterers],
            self.scatterer_powers[scatterers],
        )

    def within(self, centre_m: Array, range_m: float) -> Reflectors:
        """All that may be within `range_m` of (2,) `centre_m`: those in the bounding square of that circle."""
        low, high = centre_m - range_m, centre_m + range_m
        starts, ends = self.walls_m[:, 0], self.walls_m[:, 1]
        walls = np.all((np.minimum(starts, ends) < high) & (np.maximum(starts, ends) > low), axis=1)
        return self.select(walls, np.all((self.scatterers_m < high) & (self.scatterers_m > low), axis=1))


NOTHING = Reflectors(np.empty((0, 2, 2)), np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0))


def concatenate(*parts: Reflectors) -> Reflectors:
    """The reflectors of all parts."""
    return Reflectors(
        np.concatenate([part.walls_m for part in parts]),
        np.concatenate([part.wall_powers for part in parts]),
        np.concatenate([part.wall_transmission for part in parts]),
        np.concatenate([part.scatterers_m for part in parts]),
        np.concatenate([part.scatterer_powers for part in parts]),
    )
