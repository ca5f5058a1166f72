"""Objects away from the streets, within blocks and outside of the outermost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.building import add_building, footprint
from offradar_ros.lab.simulation.city.car_park import add_car_park
from offradar_ros.lab.simulation.city.greenery import add_grove
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.patches import Patches
from offradar_ros.lab.simulation.city.scenery import Frame, Scenery
from offradar_ros.lab.simulation.city.style import Style
from offradar_ros.lab.simulation.city.yard import add_yard

_HECTARE_M2 = 1e4
_ROW = 4
"""Rows of equal buildings are shorter than this, and `_ROW_GAP` of a depth apart."""
_ROW_GAP = 1.2


def add_infill(
    scenery: Scenery,
    ground: Ground,
    rng: np.random.Generator,
    patches: Patches,
    low_m: NDArray[np.float64],
    high_m: NDArray[np.float64],
) -> None:
    """Add car parks, buildings, yards and groves at random points between two corners, where the ground is free."""
    hectares = float(np.prod(high_m - low_m)) / _HECTARE_M2
    for attribute in ('car_parks_ha', 'infill_ha', 'yards_ha', 'groves_ha'):
        most = max(getattr(style, attribute) for style in patches.styles)
        for point in rng.uniform(low_m, high_m, (rng.poisson(most * hectares), 2)):
            style = patches.at(point)
            if rng.random() * most > getattr(style, attribute):
                continue
            if attribute == 'groves_ha':
                add_grove(scenery, rng, point, ground)
            elif attribute == 'yards_ha':
                add_yard(scenery, ground, rng, point, style.angle_rad)
            else:
                angle = style.angle_rad + float(rng.normal(0.0, 0.1)) + float(rng.integers(4)) * np.pi / 2
                frame = Frame(point, np.array([np.cos(angle), np.sin(angle)]))
                if attribute == 'car_parks_ha':
                    add_car_park(scenery, ground, rng, frame)
                else:
                    _add_buildings(scenery, ground, rng, style, frame)


def _add_buildings(scenery: Scenery, ground: Ground, rng: np.random.Generator, style: Style, frame: Frame) -> None:
    """Add a building, or in an estate a row of equal ones."""
    width, depth = float(rng.uniform(*style.width_m)), float(rng.uniform(*style.depth_m))
    count = 1 if style.template is None else int(rng.integers(1, _ROW))
    for k in range(count):
        place = Frame(frame.place(np.array([(0.0, k * (1.0 + _ROW_GAP) * depth)]))[0], frame.along)
        if ground.claim(footprint(place, width, depth)):
            own = rng if style.template is None else np.random.default_rng(style.template)
            add_building(scenery, own, style, place, width, depth)
