"""Fences and guard rails."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.scenery import Scenery

FENCE_TRANSMISSION = 0.7
_RAIL_TRANSMISSION = 0.85


def add_fence(scenery: Scenery, rng: np.random.Generator, line_m: NDArray[np.float64]) -> None:
    """Along (K, 2) points: add wire or bars, and posts."""
    scenery.add_walls(line_m, float(rng.uniform(34.0, 50.0)), FENCE_TRANSMISSION)
    _add_posts(scenery, rng, line_m, float(rng.uniform(2.0, 3.5)), float(rng.uniform(30.0, 42.0)))


def add_guard_rail(scenery: Scenery, rng: np.random.Generator, line_m: NDArray[np.float64]) -> None:
    """Along (K, 2) points: add a low strip of metal that the beam mostly passes over, and posts."""
    scenery.add_walls(line_m, float(rng.uniform(44.0, 56.0)), _RAIL_TRANSMISSION)
    _add_posts(scenery, rng, line_m, float(rng.uniform(2.0, 4.0)), float(rng.uniform(36.0, 48.0)))


def _add_posts(
    scenery: Scenery, rng: np.random.Generator, line_m: NDArray[np.float64], spacing_m: float, decibels: float
) -> None:
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line_m, axis=0).T))])
    stations = np.arange(0.0, arc[-1], spacing_m)
    posts = np.column_stack([np.interp(stations, arc, line_m[:, axis]) for axis in range(2)])
    scenery.add_points(posts, decibels + rng.normal(0.0, 3.0, len(posts)))
