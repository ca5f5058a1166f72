"""One drive along a world's route: where the radar is at each moment, and what else is on the road."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.simulation.degradation import Degradation, DegradationKind
from offradar_ros.simulation.reflectors import THROUGH, Reflectors
from offradar_ros.simulation.route import Route
from offradar_ros.simulation.world import World

Array = NDArray[np.float64]

_CAR = np.array([(x, y) for x in (-2.1, -0.7, 0.7, 2.1) for y in (-0.9, 0.9)])
_CAR_POWER = 10.0**4.5


@dataclasses.dataclass(frozen=True)
class TraversalPlan:
    """What differs from drive to drive.

    Attributes:
        name: what people call the drive.
        seed: of its noise, traffic, parked cars and degradations.
        scans: number of scans.
        start_m: where on the route it starts.
        speed_mps: mean speed; it varies by an eighth.
        left_m: mean lane offset to the left of the route's line; it varies by 0.3 m.
        reverse: whether the route is driven backwards.
        vehicles: other vehicles on the route.
        parked: share of the places to park that are taken.
        degraded: share of the scans that are degraded, by all kinds and severities alike.
        start_ns: stamp of the start.
    """

    name: str = 'drive'
    seed: int = 0
    scans: int = 200
    start_m: float = 0.0
    speed_mps: float = 8.0
    left_m: float = 0.0
    reverse: bool = False
    vehicles: int = 8
    parked: float = 0.6
    degraded: float = 0.0
    start_ns: int = 1_700_000_000_000_000_000


class Traversal:
    """A planned drive, as a function of the seconds since its start."""

    def __init__(self, plan: TraversalPlan, world: World) -> None:
        self.plan = plan
        self._route = world.route
        rng = np.random.default_rng([plan.seed, 1])
        self._phases = rng.uniform(0.0, 2.0 * np.pi, 2)
        taken = world.parking[rng.random(len(world.parking)) < plan.parked]
        self._fixed_m = np.concatenate([world.scatterers_m, _cars(taken)])
        self._fixed_powers = np.concatenate([world.scatterer_powers, np.full(len(taken) * len(_CAR), _CAR_POWER)])
        self._world = world
        self._vehicle_arcs_m = rng.uniform(0.0, world.route.length_m, plan.vehicles)
        self._vehicle_speeds = rng.uniform(0.5, 1.2, plan.vehicles) * np.where(rng.random(plan.vehicles) < 0.5, 1, -1)
        self.degradations = _degradations(plan)

    def poses_at(self, seconds: Array) -> Array:
        """(N, 3) x, y, heading of the radar at (N,) seconds."""
        plan, (speed_phase, lane_phase) = self.plan, self._phases
        wave = 2.0 * np.pi / 23.0
        swell = (np.sin(wave * seconds + speed_phase) - np.sin(speed_phase)) / (8.0 * wave)
        driven_m = plan.speed_mps * (seconds + swell)
        left_m = plan.left_m + 0.3 * np.sin(2.0 * np.pi * driven_m / 70.0 + lane_phase)
        return _along(self._route, plan.start_m, driven_m, left_m, plan.reverse)

    def reflectors_at(self, seconds: float) -> Reflectors:
        """Town, parked cars and traffic at one moment."""
        driven_m = self._vehicle_speeds * self.plan.speed_mps * seconds
        # Traffic keeps to its own side, 3.5 m off the line, whichever way it goes.
        vehicles = self._route.at(self._vehicle_arcs_m + driven_m, -3.5 * np.sign(self._vehicle_speeds))
        return Reflectors(
            self._world.walls_m,
            self._world.wall_powers,
            np.full(len(self._world.wall_powers), THROUGH),
            np.concatenate([self._fixed_m, _cars(vehicles)]),
            np.concatenate([self._fixed_powers, np.full(len(vehicles) * len(_CAR), _CAR_POWER)]),
        )


def _along(route: Route, start_m: float, driven_m: Array, left_m: Array, reverse: bool) -> Array:
    if not reverse:
        return route.at(start_m + driven_m, left_m)
    poses = route.at(start_m - driven_m, -left_m)
    poses[:, 2] += np.pi
    return poses


def _cars(poses: Array) -> Array:
    """(8·N, 2) scatterers of cars at (N, 3) poses."""
    cosine, sine = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x_m = poses[:, 0, None] + cosine * _CAR[:, 0] - sine * _CAR[:, 1]
    y_m = poses[:, 1, None] + sine * _CAR[:, 0] + cosine * _CAR[:, 1]
    return np.stack([x_m, y_m], axis=-1).reshape(-1, 2)


def _degradations(plan: TraversalPlan) -> tuple[Degradation | None, ...]:
    rng = np.random.default_rng([plan.seed, 2])
    kinds = list(DegradationKind)
    drawn = [
        Degradation(kinds[int(rng.integers(len(kinds)))], float(rng.uniform(0.3, 1.0)), int(rng.integers(400)))
        for _ in range(plan.scans)
    ]
    chosen = set(rng.permutation(plan.scans)[: round(plan.degraded * plan.scans)].tolist())
    return tuple(degradation if i in chosen else None for i, degradation in enumerate(drawn))
