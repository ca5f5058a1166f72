"""Islands of roundabouts: a kerb, planting, signs, and perhaps a tree or a monument."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.greenery import add_tree
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.scenery import Scenery
from offradar_ros.lab.simulation.roundabout import Roundabout

_MONUMENT_TRANSMISSION = 0.05


def add_island(scenery: Scenery, ground: Ground, rng: np.random.Generator, roundabout: Roundabout) -> None:
    """Add the island of a roundabout, and signs at its edge."""
    centre, radius = roundabout.centre_m, roundabout.island_m
    ground.raise_circle(centre, radius)
    kerb = _circle(radius - 0.3, max(12, round(4.0 * radius)), 0.0)
    scenery.add_points(centre + kerb, rng.uniform(20.0, 30.0) + rng.normal(0.0, 3.0, len(kerb)))
    signs = _circle(radius - 0.8, int(rng.integers(3, 6)), float(rng.uniform(0.0, 2.0 * np.pi)))
    scenery.add_points(centre + signs, rng.uniform(40.0, 52.0, len(signs)))
    for place in rng.uniform(-0.5, 0.5, (rng.poisson(0.6 * radius), 2)) * radius:
        add_tree(scenery, rng, centre + place, float(rng.uniform(0.5, 1.0)))
    drawn = rng.random()
    if drawn < 0.35:
        half = float(rng.uniform(0.6, 1.8))
        corners = centre + _circle(half, int(rng.choice([4, 6, 8])), float(rng.uniform(0.0, np.pi)))
        scenery.add_walls(corners, float(rng.uniform(48.0, 60.0)), _MONUMENT_TRANSMISSION, closed=True)
        scenery.add_points(corners, float(rng.uniform(40.0, 52.0)))
    elif drawn < 0.7:
        add_tree(scenery, rng, centre, min(radius - 1.0, float(rng.uniform(2.0, 4.0))))


def _circle(radius_m: float, count: int, start_rad: float) -> NDArray[np.float64]:
    """(count, 2) points on a circle around the origin."""
    turn = start_rad + np.arange(count) * (2.0 * np.pi / count)
    return radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
