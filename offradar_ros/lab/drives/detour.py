"""A detour: the route of a city, with a stretch of streets that the other drives do not use."""

from __future__ import annotations

import dataclasses
import heapq
import itertools

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import ConfigError
from offradar_ros.lab.simulation.route import Route
from offradar_ros.lab.simulation.streets import Edge, Streets
from offradar_ros.lab.simulation.world import World

Array = NDArray[np.float64]

_BESIDE_M = 10.0
"""The route, which cuts corners, is within this of the crossings and streets that it uses."""
_CROSSING_M = 20.0
"""The part of a street that is this near to one of its ends belongs to the crossing."""


_AROUND_M = 40.0
"""At least so much of the route is driven before a detour, and again after it."""


def with_detour(world: World, driven_m: float, length_m: float) -> World:
    """The world, whose route leaves the first `driven_m` of the given one for at least `length_m`, and comes back.

    The detour is the shortest along streets that this part of the given route does not use; of equally long ones, the
    one that leaves first. There is road of the given route before it and after it, where a drive of `driven_m` ends.
    ConfigError for a world without streets, and where there is no such detour.
    """
    if world.route is None or world.streets is None:
        raise ConfigError('a detour needs a world with streets: expected a city')
    route, streets = world.route, world.streets
    arcs_m = np.arange(0.0, min(driven_m, route.length_m))
    driven = route.at(arcs_m)[:, :2]
    apart_m = _distances_m(streets.nodes_m, driven)
    beside_m = np.full(len(streets.nodes_m), _BESIDE_M)
    for node, roundabout in streets.roundabouts.items():
        beside_m[node] = max(_BESIDE_M, roundabout.outer_m)
    passed = np.flatnonzero(streets.inner & (apart_m.min(axis=1) < beside_m))
    passed_m = {int(node): float(arcs_m[np.argmin(apart_m[node])]) for node in passed}
    nodes = _shortest_detour(streets, _unused(streets, driven), passed_m, driven_m, length_m)
    if not nodes:
        raise ConfigError(
            f'no detour of {length_m:g} m leaves and rejoins the first {driven_m:.0f} m of the route: try a shorter '
            'one, longer drives or another seed'
        )
    before_m = np.arange(0.0, passed_m[nodes[0]])
    after_m = np.arange(passed_m[nodes[-1]], route.length_m)
    detour = [streets.line(*street) for street in itertools.pairwise(nodes)]
    line = streets.joined([route.at(before_m)[:, :2], *detour, route.at(after_m)[:, :2]], nodes)
    return dataclasses.replace(world, route=Route(line, route.closed))


def _unused(streets: Streets, driven: Array) -> dict[Edge, float]:
    """Length of each street that the (M, 2) points of the driven road do not use."""
    lengths_m = {}
    for edge, line in streets.lines.items():
        between = line[_distances_m(line, line[[0, -1]]).min(axis=1) > _CROSSING_M]
        if not len(between) or _distances_m(between, driven).min() > _BESIDE_M:
            lengths_m[edge] = float(np.sum(np.hypot(*np.diff(line, axis=0).T)))
    return lengths_m


def _shortest_detour(
    streets: Streets, unused_m: dict[Edge, float], passed_m: dict[int, float], driven_m: float, length_m: float
) -> tuple[int, ...]:
    """Crossings of the detour; its ends are keys of `passed_m`, arc lengths of the route. Empty if there is none.

    Detours grow street by street, the shortest first. One that is found is no shorter than the road that it leaves
    out, so that a drive of `driven_m` does not pass the end of the driven road.
    """
    queue: list[tuple[float, float, tuple[int, ...]]]
    queue = [(0.0, leaves_m, (node,)) for node, leaves_m in passed_m.items() if leaves_m >= _AROUND_M]
    heapq.heapify(queue)
    while queue:
        so_far_m, leaves_m, nodes = heapq.heappop(queue)
        if leaves_m + so_far_m > driven_m - _AROUND_M:
            continue
        if len(nodes) > 1 and nodes[-1] in passed_m:
            if so_far_m >= max(length_m, passed_m[nodes[-1]] - leaves_m):
                return nodes
            continue
        for node in streets.neighbours[nodes[-1]]:
            street_m = unused_m.get((min(nodes[-1], node), max(nodes[-1], node)))
            # It may return to where it left, but not by the street on which it left.
            if street_m is not None and streets.inner[node] and node not in nodes[1:] and node not in nodes[-2:-1]:
                heapq.heappush(queue, (so_far_m + street_m, leaves_m, (*nodes, node)))
    return ()


def _distances_m(points: Array, others: Array) -> Array:
    """(N, M) distances between (N, 2) and (M, 2) points."""
    return np.asarray(np.linalg.norm(points[:, None] - others, axis=-1))
