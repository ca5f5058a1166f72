"""Objects away from the streets, within blocks and outside of the outermost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.building import add_building, footprint
from offradar_ros.lab.simulation.city.greenery import add_grove
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.patches import Patches
from offradar_ros.lab.simulation.city.scenery import Frame, Scenery
from offradar_ros.lab.simulation.city.yard import add_yard

_HECTARE_M2 = 1e4


def add_infill(
    scenery: Scenery,
    ground: Ground,
    rng: np.random.Generator,
    patches: Patches,
    low_m: NDArray[np.float64],
    high_m: NDArray[np.float64],
) -> None:
    """Add buildings, yards and groves at random points between two corners, where the ground is free."""
    hectares = float(np.prod(high_m - low_m)) / _HECTARE_M2
    for attribute in ('infill_ha', 'yards_ha', 'groves_ha'):
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
                width, depth = float(rng.uniform(*style.width_m)), float(rng.uniform(*style.depth_m))
                if ground.claim(footprint(frame, width, depth)):
                    add_building(scenery, rng, style, frame, width, depth)
