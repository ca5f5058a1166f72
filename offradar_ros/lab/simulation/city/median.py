"""Medians of wide streets: trees, lamp posts, rails or hedges between the carriageways."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.fences import add_guard_rail
from offradar_ros.lab.simulation.city.greenery import add_hedge, add_tree
from offradar_ros.lab.simulation.city.ground import Ground
from offradar_ros.lab.simulation.city.scenery import Scenery
from offradar_ros.lab.simulation.route import polyline_at
from offradar_ros.lab.simulation.streets import Profile, StreetKind

Array = NDArray[np.float64]

_MIN_LENGTH_M = 20.0
_STATION_M = 5.0


def add_median(
    scenery: Scenery,
    ground: Ground,
    rng: np.random.Generator,
    line_m: Array,
    profile: Profile,
    ends_m: tuple[float, float],
) -> None:
    """Add the median of a street, without `ends_m` metres at its start and end."""
    length = float(np.sum(np.hypot(*np.diff(line_m, axis=0).T)))
    first, last = ends_m[0], length - ends_m[1]
    if last - first < _MIN_LENGTH_M:
        return

    def at(along_m: Array) -> Array:
        return polyline_at(line_m, along_m, np.zeros(len(along_m)))[:, :2]

    middle = at(np.linspace(first, last, max(2, round((last - first) / _STATION_M))))
    ground.raise_strip(middle, profile.median_m)
    # Ends of the strip are round: objects stand away from them.
    if profile.kind is StreetKind.OPEN_ROAD or rng.random() < 0.25:
        add_guard_rail(scenery, rng, middle)
    elif rng.random() < 0.3:
        for k in range(0, len(middle) - 1, 2):
            add_hedge(scenery, rng, middle[k : k + 2])
    if profile.kind is StreetKind.BOULEVARD and rng.random() < 0.7:
        size = float(rng.uniform(0.8, 2.6))
        for place in at(np.arange(first + 2.0, last, float(rng.uniform(7.0, 14.0)))):
            add_tree(scenery, rng, place + rng.normal(0.0, 0.2, 2), size * float(rng.uniform(0.7, 1.2)))
    lamps = at(np.arange(first + 6.0, last, float(rng.uniform(22.0, 38.0))))
    scenery.add_points(lamps, rng.uniform(46.0, 56.0) + rng.normal(0.0, 2.0, len(lamps)))
