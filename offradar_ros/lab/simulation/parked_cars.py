"""Parked cars: at places of a world, a little beside the middle of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.vehicles import Vehicles

Array = NDArray[np.float64]

PLACE_M = (7.0, 2.8)
"""Length and width within which a parked car stands: a large van, as far beside the middle as any."""

_SPREAD = np.array([0.3, 0.15, 0.03])
"""Standard deviations of a car from its place: along it, across it (metres), and of its heading (radians)."""


class ParkedCars:
    """Cars and vans at (K, 3) x, y, heading of parking places."""

    def __init__(self, rng: np.random.Generator, places: Array) -> None:
        along, across, turned = (np.clip(rng.normal(size=places.shape), -2.0, 2.0) * _SPREAD).T
        cosine, sine = np.cos(places[:, 2]), np.sin(places[:, 2])
        beside = np.column_stack([along * cosine - across * sine, along * sine + across * cosine, turned])
        self.poses: Array = places + beside
        self._vehicles = Vehicles(rng, len(places), vans=0.15, lorries=0.0)

    def reflectors(self) -> Reflectors:
        """The reflectors of all cars."""
        return self._vehicles.reflectors(self.poses)

    def are_clear_of(self, point_m: Array, margin_m: float) -> bool:
        """Whether a (2,) point is at least `margin_m` outside of every car."""
        return bool(self._vehicles.do_not_contain(point_m, self.poses, margin_m).all())
