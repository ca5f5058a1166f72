"""Car parks: pairs of rows of parking places with an aisle between them, lamp posts, and a border."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.building import footprint
from offradar_ros.lab.simulation.city.fences import add_fence
from offradar_ros.lab.simulation.city.greenery import add_hedge, add_tree
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.scenery import Frame, Scenery

Array = NDArray[np.float64]

_PLACE_M = 5.0
_AISLE_M = 6.2
_PAIR_M = 2 * _PLACE_M + _AISLE_M
_BORDER_M = 1.2
_ENTRY_M = 7.0


def add_car_park(scenery: Scenery, ground: Ground, rng: np.random.Generator, frame: Frame) -> float:
    """Add a car park whose front lies on the frame's x axis, where the ground is free.

    Returns its width in metres, 0 if the ground is taken.
    """
    pairs, width = int(rng.integers(1, 3)), float(rng.uniform(18.0, 50.0))
    depth = pairs * _PAIR_M + 2 * _BORDER_M
    if not ground.claim(footprint(frame, width, depth), 0.02):
        return 0.0
    place_width = float(rng.uniform(2.4, 2.8))
    across = np.arange(_BORDER_M + place_width / 2, width - _BORDER_M - place_width / 2, place_width)
    for pair in range(pairs):
        start = _BORDER_M + pair * _PAIR_M
        for row, heading in ((start + _PLACE_M / 2, np.pi / 2), (start + _PAIR_M - _PLACE_M / 2, -np.pi / 2)):
            places = np.column_stack([across, np.full(len(across), row), np.full(len(across), heading)])
            scenery.add_parking(frame.place_poses(places), on_street=False)
    lamps = np.arange(rng.uniform(3.0, 12.0), width, rng.uniform(16.0, 28.0))
    for line in range(pairs + 1):
        posts = frame.place(np.column_stack([lamps, np.full(len(lamps), _BORDER_M + line * _PAIR_M)]))
        scenery.add_points(posts, rng.uniform(42.0, 54.0) + rng.normal(0.0, 2.0, len(posts)))
    _add_border(scenery, rng, frame, width, depth)
    return width


def _add_border(scenery: Scenery, rng: np.random.Generator, frame: Frame, width_m: float, depth_m: float) -> None:
    """Add a hedge, a fence, trees or nothing around it, with a gap at the front."""
    entry = float(rng.uniform(0.1, 0.9)) * (width_m - _ENTRY_M)
    corners = [(entry, 0.0), (0.0, 0.0), (0.0, depth_m), (width_m, depth_m), (width_m, 0.0), (entry + _ENTRY_M, 0.0)]
    line = frame.place(np.array(corners))
    drawn = rng.random()
    if drawn < 0.3:
        for k in range(len(line) - 1):
            add_hedge(scenery, rng, line[k : k + 2])
    elif drawn < 0.55:
        add_fence(scenery, rng, line)
    elif drawn < 0.75:
        for x in np.arange(2.0, width_m, rng.uniform(7.0, 14.0)):
            add_tree(scenery, rng, frame.place(np.array([(x, depth_m - 0.6)]))[0], float(rng.uniform(0.8, 2.0)))
