"""Trees, bushes and hedges: many weak returns, and a transmission of about a half."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.scenery import Scenery

Array = NDArray[np.float64]

HEDGE_TRANSMISSION = 0.5
_CROWN_TRANSMISSION = 0.7
_TRUNK_M = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])


def add_tree(scenery: Scenery, rng: np.random.Generator, at_m: Array, size_m: float) -> None:
    """Add a trunk and a crown of radius `size_m`; large crowns also attenuate what is behind them."""
    leaves = round(4 + 4 * size_m)
    green = scenery.vegetation
    green.add_points(at_m + rng.normal(0.0, size_m / 2, (leaves, 2)), rng.uniform(24.0, 42.0, leaves))
    scenery.add_points(at_m[None], rng.uniform(38.0, 50.0))
    if size_m > 2.0:
        turn = rng.uniform(0.0, np.pi)
        reach = 0.7 * size_m * np.array([np.cos(turn), np.sin(turn)])
        green.add_walls(at_m + np.stack([-reach, reach]), 20.0, _CROWN_TRANSMISSION)
        across = np.array([-reach[1], reach[0]])
        green.add_walls(at_m + np.stack([-across, across]), 20.0, _CROWN_TRANSMISSION)


def add_grove(scenery: Scenery, rng: np.random.Generator, at_m: Array, ground: Ground) -> None:
    """Add three to nineteen trees and bushes around (2,) `at_m`, each where the ground is free."""
    count, reach_m, size_m = int(rng.integers(3, 20)), float(rng.uniform(3.0, 14.0)), float(rng.uniform(0.6, 3.5))
    for place in at_m + rng.normal(0.0, reach_m / 1.5, (count, 2)):
        if ground.claim(place + _TRUNK_M):
            add_tree(scenery, rng, place, size_m * float(rng.uniform(0.6, 1.3)))


def add_hedge(scenery: Scenery, rng: np.random.Generator, ends_m: Array) -> None:
    """Add a hedge between (2, 2) ends."""
    green = scenery.vegetation
    green.add_walls(ends_m, float(rng.uniform(34.0, 46.0)), HEDGE_TRANSMISSION)
    length = float(np.hypot(*(ends_m[1] - ends_m[0])))
    leaves = max(1, round(length * rng.uniform(0.8, 2.0)))
    along = rng.random((leaves, 1))
    inside = ends_m[0] + along * (ends_m[1] - ends_m[0]) + rng.normal(0.0, 0.3, (leaves, 2))
    green.add_points(inside, rng.uniform(22.0, 40.0, leaves))
