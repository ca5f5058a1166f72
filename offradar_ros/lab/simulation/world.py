"""A simulated world."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import NOTHING, Reflectors
from offradar_ros.lab.simulation.road import Road
from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.streets import Streets


@dataclasses.dataclass(frozen=True, eq=False)
class World:
    """Everything that does not move, in metres east and north of the world's origin.

    Attributes:
        reflectors: walls and scatterers of hard surfaces.
        vegetation: those of trees, hedges and bushes, in leaf (`in_season`).
        parking: (K, 3) float64, x, y and heading of each parking place.
        route: the route of drives without a recorded path; None if the streets are not known.
        streets: the road network, for further routes (`make_route`); None if it is not known.
        road: where vehicles drive between kerbs, islands and parking places; None if it is not known.
        ground_seed: draws the patches and slopes of the ground.
    """

    reflectors: Reflectors
    vegetation: Reflectors = NOTHING
    parking: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.empty((0, 3)))
    route: Route | None = None
    streets: Streets | None = None
    road: Road | None = None
    ground_seed: int = 0
