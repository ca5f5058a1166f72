"""What there is to drive through."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.streets import Streets


@dataclasses.dataclass(frozen=True, eq=False)
class World:
    """Everything that stays where it is, in metres east and north of the world's origin.

    Attributes:
        reflectors: walls and scatterers.
        parking: (K, 3) float64, x, y and heading of each place where a car may stand.
        route: what traversals follow that bring no path of their own; None where the streets are not known.
        streets: the road network, for more routes (`make_route`); None where it is not known.
    """

    reflectors: Reflectors
    parking: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.empty((0, 3)))
    route: Route | None = None
    streets: Streets | None = None
