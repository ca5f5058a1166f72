"""Where the radar is at each moment of a drive."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.lanes import plan_lanes
from offradar_ros.lab.simulation.recorded_path import RecordedPath
from offradar_ros.lab.simulation.road import Road
from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.session_plan import SessionPlan

Array = NDArray[np.float64]

_STEP_S = 0.05
_AROUND_S = 5.0
_BRAKING_S = 5.0
_WANDER_M = 0.3


class Motion(Protocol):
    """Poses as a function of time."""

    def at(self, seconds: Array) -> Array:
        """(N, 3) x, y, heading of the radar at (N,) seconds since the start."""


class RouteMotion:
    """Along a lane of a route, with a speed and an offset that vary, and with stops."""

    def __init__(self, plan: SessionPlan, route: Route, road: Road | None, duration_s: float) -> None:
        rng = np.random.default_rng([plan.seed, 1])
        speed_phase, self._lane_phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        self._plan = plan
        (lane,) = plan_lanes(route, road, (-plan.left_m if plan.reverse else plan.left_m,))
        self._line, self._start_m = lane.line, lane.arc_m(plan.start_m)
        self._seconds = np.arange(-_AROUND_S, duration_s + _AROUND_S, _STEP_S)
        speeds = plan.speed_mps * (1.0 + np.cos(2.0 * np.pi / 23.0 * self._seconds + speed_phase) / 8.0)
        middles, halves = rng.uniform(0.0, duration_s, plan.stops), rng.uniform(2.0, 6.0, plan.stops)
        for middle, half in zip(middles.tolist(), halves.tolist(), strict=True):
            speeds *= np.clip((np.abs(self._seconds - middle) - half) / _BRAKING_S, 0.0, 1.0)
        driven = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) * (_STEP_S / 2))])
        self._driven_m = driven - np.interp(0.0, self._seconds, driven)

    def at(self, seconds: Array) -> Array:
        """As `Motion`."""
        driven_m = np.interp(seconds, self._seconds, self._driven_m)
        aside_m = _WANDER_M * np.sin(2.0 * np.pi * driven_m / 70.0 + self._lane_phase)
        if not self._plan.reverse:
            return self._line.at(self._start_m + driven_m, aside_m)
        return _reversed(self._line.at(self._start_m - driven_m, -aside_m))


class PathMotion:
    """A recorded path, forwards or backwards, with a lane offset."""

    def __init__(self, plan: SessionPlan, path: RecordedPath) -> None:
        self._path = path
        self._left_m = plan.left_m
        self._reverse = plan.reverse
        self._start_s = path.seconds_at(plan.start_m)

    def at(self, seconds: Array) -> Array:
        """As `Motion`."""
        poses = self._path.at(self._start_s - seconds if self._reverse else self._start_s + seconds)
        if self._reverse:
            poses = _reversed(poses)
        poses[:, 0] -= self._left_m * np.sin(poses[:, 2])
        poses[:, 1] += self._left_m * np.cos(poses[:, 2])
        return poses


def _reversed(poses: Array) -> Array:
    return np.asarray(poses + np.array([0.0, 0.0, np.pi]))
