"""Lanes along a route: as far from its line as wanted, where the road allows it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.road import Road
from offradar_ros.lab.simulation.route import Route

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_STATION_M = 2.0
_STEP_M = 0.25
"""A lane moves aside by up to this between two stations, an eighth of the distance."""

_REACH = 48
"""Steps to either side of where a lane is wanted that are tried."""

_BLOCKED = 1e4
_MOVED = 0.1
_TO_THE_LEFT = 0.02
"""Costs of a station that is not free, of a step aside, and of a metre to the left: of two equal ways, the right."""

_MIN_RADIUS_M = 3.5
"""Of curves, before they are smoothed."""

_CORNER_M = 5
_SMOOTHED = 5
"""Stations over which a lane is averaged."""


@dataclasses.dataclass(frozen=True, eq=False)
class Lane:
    """A lane beside a route.

    Attributes:
        line: the lane, by its own arc length.
        beside_m: (M,) float64, arc length of the route at equal steps.
        lane_m: (M,) float64, arc length of the lane there.
    """

    line: Route
    beside_m: Array
    lane_m: Array

    def arc_m(self, route_arc_m: float) -> float:
        """Arc length of the lane beside an arc length of the route."""
        inside = np.mod(route_arc_m, self.beside_m[-1]) if self.line.closed else route_arc_m
        return float(np.interp(inside, self.beside_m, self.lane_m))


def plan_lanes(route: Route, road: Road | None, wanted_m: tuple[float, ...]) -> tuple[Lane, ...]:
    """Lanes at wanted distances to the left of a route, in metres, or as near to that as they can be.

    Each is the line of least cost from station to station: the sum of its squared distances from where it is wanted,
    with the road's edges, islands, medians and parked cars as obstacles (Viterbi's algorithm). Without a road, only
    curves that are too tight are in the way.
    """
    stations_m = np.linspace(0.0, route.length_m, max(8, round(route.length_m / _STATION_M)), endpoint=not route.closed)
    distances_m = np.array(wanted_m)[:, None] + _STEP_M * np.arange(-_REACH, _REACH + 1)
    cost = _costs(route, road, stations_m, distances_m, np.array(wanted_m))
    path = _cheapest(cost) if not route.closed else _lap(_cheapest(np.concatenate([cost, cost])), len(cost))
    lanes = []
    for steps, beside in zip(path.T, distances_m, strict=True):
        left_m = _smoothed(beside[steps], route.closed)
        lanes.append(_lane(route, stations_m, left_m))
    return tuple(lanes)


def _lane(route: Route, stations_m: Array, left_m: Array) -> Lane:
    """The lane that is (S,) metres to the left of the route at (S,) stations."""
    arcs_m = np.linspace(0.0, route.length_m, max(2, round(route.length_m) + 1))
    period = route.length_m if route.closed else None
    points_m = route.at(arcs_m, np.interp(arcs_m, stations_m, left_m, period=period))[:, :2]
    line = Route(points_m[:-1] if route.closed else points_m, route.closed, corner_length_m=_CORNER_M)
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))])
    return Lane(line, arcs_m, driven_m * (line.length_m / driven_m[-1]))


def _costs(route: Route, road: Road | None, stations_m: Array, left_m: Array, wanted_m: Array) -> Array:
    """(S, L, K) costs of (S,) stations at (L, K) distances to the left of the route, of which (L,) are wanted."""
    x, y, heading = (column[:, None, None] for column in route.at(stations_m).T)
    ahead, behind = (route.at(stations_m + side)[:, 2] for side in (1.0, -1.0))
    curvature = np.angle(np.exp(1j * (ahead - behind))) / 2.0
    curvature = curvature[:, None, None]
    blocked = 1.0 - curvature * left_m < _MIN_RADIUS_M * np.abs(curvature)
    if road is not None:
        points_m = np.stack([x - left_m * np.sin(heading), y + left_m * np.cos(heading)], axis=-1)
        blocked |= ~road.is_free(points_m)
    return np.asarray((left_m - wanted_m[:, None]) ** 2 + _TO_THE_LEFT * left_m + _BLOCKED * blocked)


def _lap(path: Index, stations: int) -> Index:
    """(S, L) indices of one lap, from those of two: from the station where both are nearest to one another."""
    apart = np.abs(path[:stations] - path[stations:])
    laps = [np.roll(lane[k : k + stations], k) for lane, k in zip(path.T, np.argmin(apart, axis=0), strict=True)]
    return np.stack(laps, axis=1)


def _cheapest(cost: Array) -> Index:
    """(S, L) index of least total cost at each station, from (S, L, K) costs; it changes by one at most."""
    total = cost[0]
    moves = np.zeros(cost.shape, np.int8)
    wall = np.full((cost.shape[1], 1), np.inf)
    for station in range(1, len(cost)):
        down = np.hstack([wall, total[:, :-1] + _MOVED])
        up = np.hstack([total[:, 1:] + _MOVED, wall])
        move = np.where(down < total, -1, 0)
        total = np.minimum(total, down)
        move[up < total] = 1
        moves[station] = move
        total = np.minimum(total, up) + cost[station]
    path = np.empty(cost.shape[:2], np.intp)
    path[-1] = np.argmin(total, axis=1)
    lanes = np.arange(cost.shape[1])
    for station in range(len(cost) - 1, 0, -1):
        path[station - 1] = path[station] + moves[station, lanes, path[station]]
    return path


def _smoothed(values: Array, closed: bool) -> Array:
    padded = np.pad(values, _SMOOTHED // 2, mode='wrap' if closed else 'edge')
    return np.convolve(padded, np.full(_SMOOTHED, 1.0 / _SMOOTHED), 'valid')
