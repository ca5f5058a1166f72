"""Buildings: fronts with recesses and balconies, and what glitters on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.scenery import Frame, Scenery
from offradar_ros.lab.simulation.city.style import Style

Array = NDArray[np.float64]

_THROUGH = (0.002, 0.04)
_BALCONY_THROUGH = 0.5


def footprint(frame: Frame, width_m: float, depth_m: float) -> Array:
    """(4, 2) corners of the ground that a building stands on, its front along the frame's x axis."""
    return frame.place(np.array([(0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m)]))


def add_building(
    scenery: Scenery, rng: np.random.Generator, style: Style, frame: Frame, width_m: float, depth_m: float
) -> None:
    """Walls all round, stronger and weaker points on them where windows, pipes and corners are."""
    decibels = float(rng.uniform(*style.wall_db))
    bays = max(1, round(width_m / rng.uniform(4.0, 9.0)))
    edges = np.linspace(0.0, width_m, bays + 1)
    recesses = np.where(rng.random(bays) < style.bays, rng.uniform(0.3, min(2.0, depth_m / 3), bays), 0.0)
    front = np.array([(x, y) for k, y in enumerate(recesses) for x in edges[k : k + 2]])
    # Bays of one depth are one wall.
    turns = np.r_[True, np.abs(np.diff(front[:, 1], 2)) > 0, True] if len(front) > 2 else np.ones(len(front), np.bool_)
    outline = np.vstack([front[turns], [(width_m, depth_m), (0.0, depth_m)]])
    through = float(np.exp(rng.uniform(*np.log(_THROUGH))))
    scenery.add_walls(frame.place(outline), decibels, through, closed=True)
    scenery.add_points(frame.place(outline), decibels - rng.uniform(8.0, 20.0, len(outline)))
    _add_details(scenery, rng, frame, outline, decibels)
    for k in np.flatnonzero(rng.random(bays) < style.balconies):
        _add_balcony(scenery, rng, frame, (edges[k] + edges[k + 1]) / 2, recesses[k])


def _add_details(scenery: Scenery, rng: np.random.Generator, frame: Frame, outline: Array, decibels: float) -> None:
    """Points every few metres of the outline, a hand's breadth before the wall."""
    ends = np.roll(outline, -1, axis=0)
    lengths = np.hypot(*(ends - outline).T)
    counts = rng.poisson(lengths / rng.uniform(2.0, 6.0))
    sides = np.repeat(np.arange(len(outline)), counts)
    along = rng.random(len(sides))[:, None]
    step = (ends - outline)[sides]
    outwards = np.column_stack([step[:, 1], -step[:, 0]]) / np.maximum(lengths[sides, None], 1e-9)
    scenery.add_points(
        frame.place(outline[sides] + along * step + 0.15 * outwards), decibels - rng.uniform(6.0, 26.0, len(sides))
    )


def _add_balcony(scenery: Scenery, rng: np.random.Generator, frame: Frame, middle_m: float, recess_m: float) -> None:
    half, out = float(rng.uniform(0.8, 1.8)), float(rng.uniform(0.7, 1.4))
    box = np.array([(-half, 0.0), (-half, -out), (half, -out), (half, 0.0)]) + np.array([middle_m, recess_m])
    corners = frame.place(box)
    decibels = float(rng.uniform(38.0, 50.0))
    scenery.add_walls(corners, decibels, _BALCONY_THROUGH)
    scenery.add_points(corners[1:3], decibels)
