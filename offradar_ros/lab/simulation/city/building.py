"""Buildings: fronts with recesses and balconies, and scatterers on their walls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.scenery import Frame, Scenery
from offradar_ros.lab.simulation.city.style import Style

Array = NDArray[np.float64]

_TRANSMISSION = (0.002, 0.04)
_BALCONY_TRANSMISSION = 0.5


def footprint(frame: Frame, width_m: float, depth_m: float) -> Array:
    """(4, 2) corners of the area of a building whose front lies on the frame's x axis."""
    return frame.place(np.array([(0.0, 0.0), (width_m, 0.0), (width_m, depth_m), (0.0, depth_m)]))


def add_building(
    scenery: Scenery, rng: np.random.Generator, style: Style, frame: Frame, width_m: float, depth_m: float
) -> None:
    """Add walls on all sides, and scatterers on them for corners, windows and pipes."""
    decibels = float(rng.uniform(*style.wall_db))
    bays = max(1, round(width_m / rng.uniform(4.0, 9.0)))
    edges = np.linspace(0.0, width_m, bays + 1)
    recesses = np.where(rng.random(bays) < style.bays, rng.uniform(0.3, min(2.0, depth_m / 3), bays), 0.0)
    front = np.array([(x, y) for k, y in enumerate(recesses) for x in edges[k : k + 2]])
    # Neighbouring bays of the same depth share one wall.
    turns = np.r_[True, np.abs(np.diff(front[:, 1], 2)) > 0, True] if len(front) > 2 else np.ones(len(front), np.bool_)
    outline = np.vstack([front[turns], [(width_m, depth_m), (0.0, depth_m)]])
    transmission = float(np.exp(rng.uniform(*np.log(_TRANSMISSION))))
    scenery.add_walls(frame.place(outline), decibels, transmission, closed=True)
    scenery.add_points(frame.place(outline), decibels - rng.uniform(8.0, 20.0, len(outline)))
    _add_details(scenery, rng, frame, outline, decibels)
    for k in np.flatnonzero(rng.random(bays) < style.balconies):
        _add_balcony(scenery, rng, frame, (edges[k] + edges[k + 1]) / 2, recesses[k])


def _add_details(scenery: Scenery, rng: np.random.Generator, frame: Frame, outline: Array, decibels: float) -> None:
    """Add scatterers every few metres of the outline, 0.15 m in front of the wall."""
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
    scenery.add_walls(corners, decibels, _BALCONY_TRANSMISSION)
    scenery.add_points(corners[1:3], decibels)
