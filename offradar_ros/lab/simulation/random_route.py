"""Random routes through streets."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.streets import Streets

Array = NDArray[np.float64]
_Step = tuple[int, int]
_Walk = list[_Step]
_REPETITION_COST = 4.0
"""Each earlier drive along a street makes it cost this many times its length more."""


def make_route(streets: Streets, seed: int, min_length_m: float, closed: bool = True) -> Route:
    """A route of at least `min_length_m` from crossing to crossing, without U-turns.

    It goes to random streets, one after another, and avoids streets that it has used. A closed route returns to its
    first street. The same seed gives the same route.
    """
    rng = np.random.default_rng([seed, 4])
    inside = [(a, b) for edge in streets.lines if streets.inner[list(edge)].all() for a, b in (edge, edge[::-1])]
    first = inside[int(rng.integers(len(inside)))]
    walk, used = [first], {frozenset(first): 1}
    length_m, home = _length(streets, first), _Walk()
    while len(walk) < 2 or length_m + sum(_length(streets, step) for step in home) < min_length_m:
        goal = inside[int(rng.integers(len(inside)))]
        for step in _shortest_path(streets, walk[-1], goal, used):
            walk.append(step)
            used[frozenset(step)] = used.get(frozenset(step), 0) + 1
            length_m += _length(streets, step)
            if closed and length_m >= min_length_m / 2:
                home = _shortest_path(streets, step, first, used)[:-1]
            if length_m + sum(_length(streets, onward) for onward in home) >= min_length_m:
                break
    if closed:
        walk += home or _shortest_path(streets, walk[-1], first, used)[:-1]
    parts = [streets.line(*step) for step in walk]
    if not closed:
        return Route(_between_roundabouts(streets, walk, parts), closed)
    # A closed line starts within its first street, so that its ends do not meet at a crossing.
    middle = len(parts[0]) // 2
    parts = [parts[0][middle:], *parts[1:], parts[0][: middle + 1]]
    return Route(streets.joined(parts, [step[1] for step in walk])[:-1], closed)


def _between_roundabouts(streets: Streets, walk: _Walk, parts: list[Array]) -> Array:
    """(M, 2) line of an open walk, which does not start or end on an island."""
    for node, part, backwards in ((walk[0][0], 0, -1), (walk[-1][1], -1, 1)):
        if node in streets.roundabouts:
            parts[part] = streets.roundabouts[node].outside(parts[part][::backwards])[::backwards]
    return streets.joined(parts, [step[1] for step in walk[:-1]])


def _length(streets: Streets, step: _Step) -> float:
    return float(np.sum(np.hypot(*np.diff(streets.line(*step), axis=0).T)))


def _shortest_path(streets: Streets, start: _Step, goal: _Step, used: dict[frozenset[int], int]) -> _Walk:
    """Steps after `start` up to and including `goal`, by Dijkstra's algorithm over directed streets; empty for none."""
    best: dict[_Step, float] = {}
    previous: dict[_Step, _Step] = {}
    queue: list[tuple[float, _Step, _Step | None]] = [(0.0, start, None)]
    while queue:
        cost, step, before = heapq.heappop(queue)
        if before is not None:
            if step in best:
                continue
            best[step], previous[step] = cost, before
            if step == goal:
                break
        for node in streets.neighbours[step[1]]:
            onward = (step[1], node)
            if node != step[0] and streets.inner[node] and onward not in best:
                factor = 1.0 + _REPETITION_COST * used.get(frozenset(onward), 0)
                heapq.heappush(queue, (cost + factor * _length(streets, onward), onward, step))
    if goal not in previous:
        return []
    path = [goal]
    while previous[path[-1]] != start:
        path.append(previous[path[-1]])
    return path[::-1]
