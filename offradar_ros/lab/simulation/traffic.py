"""Other vehicles on the road."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.lanes import plan_lanes
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.road import Road
from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.vehicles import Vehicles

Array = NDArray[np.float64]

_LANE_M = 3.5
"""Distance of traffic to the right of the line, in either direction, where the road is wide enough."""

_ASIDE_M = 0.4
"""Vehicles are up to this far beside their lane."""

_FROM_RADAR_M = 0.7


class Traffic:
    """Vehicles on a route, about half in each direction, each at its own speed; they start again at the end."""

    def __init__(self, plan: SessionPlan, route: Route, road: Road | None) -> None:
        rng = np.random.default_rng([plan.seed, 7])
        count = round(plan.traffic * route.length_m / 1000.0)
        self._lines = [lane.line for lane in plan_lanes(route, road, (-_LANE_M, _LANE_M))]
        self._shares = rng.random(count)
        self._backwards = rng.integers(0, 2, count)
        self._speeds_mps = rng.uniform(0.4, 1.3, count) * plan.speed_mps * np.where(self._backwards, -1.0, 1.0)
        self._aside_m = np.clip(rng.normal(0.0, 0.3, count), -_ASIDE_M, _ASIDE_M)
        self._vehicles = Vehicles(rng, count, vans=0.15, lorries=0.1)

    def at(self, seconds: float, centre_m: Array) -> Reflectors:
        """All vehicles at one moment, without any that would contain a radar at (2,) `centre_m`."""
        poses = self.poses_at(seconds)
        return self._vehicles.reflectors(poses, self._vehicles.do_not_contain(centre_m, poses, _FROM_RADAR_M))

    def poses_at(self, seconds: float) -> Array:
        """(N, 3) x, y, heading of the lane at each vehicle."""
        poses = np.empty((len(self._shares), 3))
        for lane, line in enumerate(self._lines):
            chosen = self._backwards == lane
            driven_m = self._shares[chosen] * line.length_m + self._speeds_mps[chosen] * seconds
            poses[chosen] = line.at(np.mod(driven_m, line.length_m), self._aside_m[chosen])
        return poses
