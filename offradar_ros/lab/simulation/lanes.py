"""Lanes along a route: as far from its line as wanted, where the road allows it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.road import Road
from offradar_ros.lab.simulation.route import Route

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_STATION_M = 2.0
_STEP_M = 0.25
"""A lane moves aside by up to this between two stations, an eighth of the distance."""

_REACH_M = 12.0
_BLOCKED = 1e4
_MOVED = 0.1
_TO_THE_LEFT = 0.02
"""Costs of a station that is not free, of a step aside, and of a metre to the left: of two equal ways, the right one."""

_MIN_SPACING = 0.35
"""On the inner side of a curve, a lane's length is at least this share of the line's."""

_SMOOTHED = 5
"""Stations over which a lane is averaged."""


class Lanes:
    """Lanes at wanted distances to the left of a route, in metres; without a road, they are exactly there.

    On a road each lane is the line of least cost from station to station: the sum of its squared distances from where it
    is wanted, with the road's edges, islands, medians and parked cars as obstacles (Viterbi's algorithm).
    """

    def __init__(self, route: Route, road: Road | None, wanted_m: tuple[float, ...]) -> None:
        self._route = route
        self._wanted_m = np.array(wanted_m)
        count = max(8, round(route.length_m / _STATION_M))
        self._arcs_m = np.linspace(0.0, route.length_m, count, endpoint=not route.closed)
        self._left_m = np.repeat(self._wanted_m[:, None], count, axis=1)
        if road is not None:
            self._left_m = self._planned(road)

    def at(self, arc_m: Array, lane: Index | int = 0, aside_m: Array | float = 0.0) -> Array:
        """(N, 3) x, y, heading at (N,) arc lengths of a lane, or of one lane each, and `aside_m` to the left of it.

        The heading is that of the lane.
        """
        left_m = self._left_at(arc_m, lane)
        poses = self._route.at(arc_m, left_m + aside_m)
        poses[:, 2] += np.arctan(self._left_at(arc_m + 0.5, lane) - self._left_at(arc_m - 0.5, lane))
        return poses

    def _left_at(self, arc_m: Array, lane: Index | int) -> Array:
        period = self._route.length_m if self._route.closed else None
        offsets = np.stack([np.interp(arc_m, self._arcs_m, left, period=period) for left in self._left_m])
        return np.asarray(offsets[lane, np.arange(len(arc_m))])

    def _planned(self, road: Road) -> Array:
        """(L, S) metres to the left of each station."""
        cost, left_m = self._costs(road)
        stations = np.arange(len(cost))
        # Of two laps of a closed route, that one is taken whose ends meet best.
        laps = 2 if self._route.closed else 1
        path = _cheapest(np.concatenate([cost] * laps))
        planned = []
        for lane in range(len(self._wanted_m)):
            steps = path[:, lane]
            if self._route.closed:
                first = int(np.argmin(np.abs(steps[stations] - steps[stations + len(stations)])))
                steps = np.roll(steps[first : first + len(stations)], first)
            planned.append(_smoothed(left_m[lane, steps], self._route.closed))
        return np.array(planned)

    def _costs(self, road: Road) -> tuple[Array, Array]:
        """(S, L, K) costs of each station, lane and distance, and (L, K) those distances to the left of the line."""
        reach = round(_REACH_M / _STEP_M)
        left_m = self._wanted_m[:, None] + _STEP_M * np.arange(-reach, reach + 1)
        poses = self._route.at(self._arcs_m)
        x, y, heading = (column[:, None, None] for column in poses.T)
        points_m = np.stack([x - left_m * np.sin(heading), y + left_m * np.cos(heading)], axis=-1)
        ahead, behind = (self._route.at(self._arcs_m + side)[:, 2] for side in (1.0, -1.0))
        curvature = np.angle(np.exp(1j * (ahead - behind))) / 2.0
        blocked = ~road.is_free(points_m) | (1.0 - curvature[:, None, None] * left_m < _MIN_SPACING)
        cost = (left_m - self._wanted_m[:, None]) ** 2 + _TO_THE_LEFT * left_m
        return cost + _BLOCKED * blocked, left_m


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
