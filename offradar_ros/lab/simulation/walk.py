"""Random walks through the streets, as routes."""

from __future__ import annotations

import heapq

import numpy as np

from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.streets import Streets

_Step = tuple[int, int]
_Walk = list[_Step]
_AGAIN = 4.0
"""A street that was driven before counts this much longer for every time."""


def make_route(streets: Streets, seed: int, least_m: float, closed: bool = True) -> Route:
    """A walk of at least `least_m` from crossing to crossing that never turns round in a street.

    It heads for random crossings, one after another, and avoids streets that it has used. A closed one returns to its
    first street. The same seed gives the same walk.
    """
    rng = np.random.default_rng([seed, 4])
    inside = [(a, b) for edge in streets.lines if streets.inner[list(edge)].all() for a, b in (edge, edge[::-1])]
    first = inside[int(rng.integers(len(inside)))]
    walk, used = [first], {frozenset(first): 1}
    length_m, home = _length(streets, first), _Walk()
    while len(walk) < 2 or length_m + sum(_length(streets, step) for step in home) < least_m:
        goal = inside[int(rng.integers(len(inside)))]
        for step in _way(streets, walk[-1], goal, used):
            walk.append(step)
            used[frozenset(step)] = used.get(frozenset(step), 0) + 1
            length_m += _length(streets, step)
            if closed and length_m >= least_m / 2:
                home = _way(streets, step, first, used)[:-1]
            if length_m + sum(_length(streets, onward) for onward in home) >= least_m:
                break
    if closed:
        walk += home or _way(streets, walk[-1], first, used)[:-1]
    end = streets.nodes_m[[walk[-1][1]]]
    return Route(np.concatenate([*(streets.line(*step)[:-1] for step in walk), *([] if closed else [end])]), closed)


def _length(streets: Streets, step: _Step) -> float:
    return float(np.sum(np.hypot(*np.diff(streets.line(*step), axis=0).T)))


def _way(streets: Streets, start: _Step, goal: _Step, used: dict[frozenset[int], int]) -> _Walk:
    """Steps after `start` up to and with `goal`, by Dijkstra's algorithm over directed streets; empty for none."""
    best: dict[_Step, float] = {}
    came: dict[_Step, _Step] = {}
    queue: list[tuple[float, _Step, _Step | None]] = [(0.0, start, None)]
    while queue:
        cost, step, before = heapq.heappop(queue)
        if before is not None:
            if step in best:
                continue
            best[step], came[step] = cost, before
            if step == goal:
                break
        for node in streets.around[step[1]]:
            onward = (step[1], node)
            if node != step[0] and streets.inner[node] and onward not in best:
                again = 1.0 + _AGAIN * used.get(frozenset(onward), 0)
                heapq.heappush(queue, (cost + again * _length(streets, onward), onward, step))
    if goal not in came:
        return []
    way = [goal]
    while came[way[-1]] != start:
        way.append(came[way[-1]])
    return way[::-1]
