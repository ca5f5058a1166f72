"""One drive through a world: the pose of the radar and the reflectors around it at each moment."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import ConfigError
from offradar_ros.lab.simulation.foliage import in_season
from offradar_ros.lab.simulation.motion import Motion, PathMotion, RouteMotion
from offradar_ros.lab.simulation.parked_cars import ParkedCars
from offradar_ros.lab.simulation.reflector_index import ReflectorIndex
from offradar_ros.lab.simulation.reflectors import Reflectors, concatenate
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.traffic import Traffic
from offradar_ros.lab.simulation.world import World

Array = NDArray[np.float64]


class Traversal:
    """A planned drive, as a function of the seconds since its start.

    Attributes:
        parked: the cars that are parked along the way.

    ConfigError if the plan has no path and the world no route.
    """

    def __init__(self, plan: SessionPlan, world: World, duration_s: float) -> None:
        route = plan.path.route() if plan.path else world.route
        if route is None:
            raise ConfigError(f'drive {plan.name}: the world has no streets: give the drive a recorded path')
        road = None if plan.path else world.road
        self._motion: Motion = PathMotion(plan, plan.path) if plan.path else RouteMotion(plan, route, road, duration_s)
        rng = np.random.default_rng([plan.seed, 6])
        self.parked = ParkedCars(rng, world.parking[rng.random(len(world.parking)) < plan.parked])
        self._static = ReflectorIndex(
            concatenate(world.reflectors, in_season(world.vegetation, plan.foliage), self.parked.reflectors())
        )
        self._traffic = Traffic(plan, route, road)

    def poses_at(self, seconds: Array) -> Array:
        """(N, 3) x, y, heading of the radar at (N,) seconds."""
        return self._motion.at(seconds)

    def reflectors_at(self, seconds: float, range_m: float) -> Reflectors:
        """World, parked cars and traffic within `range_m` of the radar, and some reflectors that are further away."""
        centre_m = self.poses_at(np.array([seconds]))[0, :2]
        return concatenate(self._static.near(centre_m, range_m), self._traffic.at(seconds, centre_m))
