"""Other vehicles: boxes of sheet metal, with strong returns from corners, that occlude what is behind them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import Reflectors

Array = NDArray[np.float64]

_OUTLINE = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
_POINTS = np.array([(x, y) for x in (-0.5, -0.3, 0.3, 0.5) for y in (-0.48, 0.48)])
# Car, van, lorry or bus: length and width in metres, decibels of a side and of a corner, transmission of a side.
_KINDS = np.array(
    [(4.4, 1.8, 38.0, 45.0, 0.5), (5.6, 2.0, 44.0, 47.0, 0.3), (10.5, 2.5, 54.0, 52.0, 0.05)], dtype=np.float64
)


class Vehicles:
    """Vehicles of different kind, size and power; `vans` and `lorries` are shares of them."""

    def __init__(self, rng: np.random.Generator, count: int, vans: float, lorries: float) -> None:
        drawn = rng.random(count)
        kinds = _KINDS[np.where(drawn < lorries, 2, np.where(drawn < lorries + vans, 1, 0))]
        self.sizes_m: Array = kinds[:, :2] * rng.uniform(0.88, 1.12, (count, 2))
        self._transmission = kinds[:, 4]
        self._sides = 10.0 ** ((kinds[:, 2] + rng.normal(0.0, 3.0, count)) / 10.0)
        self._corners = 10.0 ** ((kinds[:, 3, None] + rng.normal(0.0, 4.0, (count, len(_POINTS)))) / 10.0)

    def __len__(self) -> int:
        return len(self.sizes_m)

    def reflectors(self, poses: Array, chosen: NDArray[np.bool_] | slice = slice(None)) -> Reflectors:
        """Reflectors of the `chosen` of N vehicles at (N, 3) poses."""
        poses, sizes_m = poses[chosen], self.sizes_m[chosen]
        outlines = _transformed(_OUTLINE, sizes_m, poses)
        return Reflectors(
            np.stack([outlines, np.roll(outlines, -1, axis=1)], axis=2).reshape(-1, 2, 2),
            np.repeat(self._sides[chosen], len(_OUTLINE)),
            np.repeat(self._transmission[chosen], len(_OUTLINE)),
            _transformed(_POINTS, sizes_m, poses).reshape(-1, 2),
            self._corners[chosen].ravel(),
        )

    def do_not_contain(self, point_m: Array, poses: Array, margin_m: float) -> NDArray[np.bool_]:
        """(N,) whether a (2,) point is at least `margin_m` outside of each vehicle at (N, 3) poses."""
        offset = point_m - poses[:, :2]
        cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        inside = np.column_stack(
            [cosine * offset[:, 0] + sine * offset[:, 1], cosine * offset[:, 1] - sine * offset[:, 0]]
        )
        return np.asarray(np.any(np.abs(inside) > self.sizes_m / 2 + margin_m, axis=1))


def _transformed(shape: Array, sizes_m: Array, poses: Array) -> Array:
    """(N, K, 2) points from (K, 2) points of a unit square, scaled to (N, 2) sizes, at (N, 3) poses."""
    x_m, y_m = shape[:, 0] * sizes_m[:, :1], shape[:, 1] * sizes_m[:, 1:]
    cosine, sine = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    return np.stack([poses[:, :1] + cosine * x_m - sine * y_m, poses[:, 1:2] + sine * x_m + cosine * y_m], axis=-1)
