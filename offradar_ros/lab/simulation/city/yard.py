"""Metal objects in yards: rows of containers, and tanks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.scenery import Frame, Scenery

_TRANSMISSION = 0.02


def add_yard(
    scenery: Scenery, ground: Ground, rng: np.random.Generator, at_m: NDArray[np.float64], angle_rad: float
) -> None:
    """Add one to eight containers side by side, or a round tank, where the ground is free."""
    decibels = float(rng.uniform(54.0, 66.0))
    if rng.random() < 0.3:
        radius, turn = float(rng.uniform(2.0, 7.0)), np.arange(10) * (2 * np.pi / 10)
        outlines = [at_m + radius * np.column_stack([np.cos(turn), np.sin(turn)])]
    else:
        frame = Frame(at_m, np.array([np.cos(angle_rad), np.sin(angle_rad)]))
        box = np.array([(0.0, 0.0), (12.2, 0.0), (12.2, 2.4), (0.0, 2.4)]) * (1.0 if rng.random() < 0.6 else 0.5, 1.0)
        spacing = float(rng.uniform(2.6, 5.0))
        outlines = [frame.place(box + np.array([0.0, k * spacing])) for k in range(int(rng.integers(1, 9)))]
    for outline in outlines:
        if ground.claim(outline, 0.05):
            scenery.add_walls(outline, decibels, _TRANSMISSION, closed=True)
            scenery.add_points(outline, decibels - rng.uniform(6.0, 16.0, len(outline)))
