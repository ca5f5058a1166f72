"""Roundabouts: an island, and a ring around it that is driven counter-clockwise."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STEP_M = 1.5


@dataclasses.dataclass(frozen=True, eq=False)
class Roundabout:
    """A crossing with an island.

    Attributes:
        centre_m: (2,) float64.
        island_m: radius of the island.
        outer_m: radius of the outer kerb.
    """

    centre_m: Array
    island_m: float
    outer_m: float

    @property
    def driven_m(self) -> float:
        """Radius of the middle of the ring."""
        return (self.island_m + self.outer_m) / 2

    def joined(self, before_m: Array, after_m: Array) -> Array:
        """(M, 2) line along one that ends near the centre, round the island, and along one that starts near it."""
        before_m, after_m = self.outside(before_m), self.outside(after_m[::-1])[::-1]
        first, last = (np.arctan2(*(end - self.centre_m)[::-1]) for end in (before_m[-1], after_m[0]))
        turn = float(np.mod(last - first, 2.0 * np.pi))
        angles = first + np.linspace(0.0, turn, max(2, round(turn * self.driven_m / _STEP_M)))
        ring_m = self.centre_m + self.driven_m * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.concatenate([before_m, ring_m, after_m])

    def outside(self, line_m: Array) -> Array:
        """The part of an (M, 2) line up to where it enters the ring for the last time."""
        far = np.flatnonzero(np.hypot(*(line_m - self.centre_m).T) > self.driven_m)
        return line_m[: far[-1] + 1]
