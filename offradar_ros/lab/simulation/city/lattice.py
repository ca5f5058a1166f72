"""Streets of a city: an irregular, bent grid without some of its edges, or a regular one of equal, straight streets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.city.profiles import draw_profiles
from offradar_ros.lab.simulation.roundabout import Roundabout
from offradar_ros.lab.simulation.streets import Edge, Profile, Streets, neighbours

Array = NDArray[np.float64]


_ROUNDABOUTS = 0.12
"""Share of the crossings of three or more streets."""


def make_streets(rng: np.random.Generator, plan: CityPlan, regular: bool) -> Streets:
    """Streets around and between the blocks of the plan, and one block more on every side."""
    columns, rows = plan.blocks[0] + 3, plan.blocks[1] + 3
    nodes = _turned(rng, _regular(columns, rows) if regular else _irregular(rng, columns, rows)) * plan.block_m
    index = np.arange(columns * rows).reshape(columns, rows)
    edges = [(int(a), int(b)) for a, b in zip(index[:-1].ravel(), index[1:].ravel(), strict=True)]
    edges += [(int(a), int(b)) for a, b in zip(index[:, :-1].ravel(), index[:, 1:].ravel(), strict=True)]
    inner = np.zeros((columns, rows), np.bool_)
    inner[1:-1, 1:-1] = True
    edges = _thinned(rng, edges, inner.ravel(), round(rng.uniform(0.05, 0.2) * len(edges)))
    bend = 0.0 if regular else float(rng.uniform(0.0, 0.09))
    profiles = draw_profiles(rng, edges, rows, plan.block_m, regular)
    return Streets(
        nodes_m=nodes,
        inner=inner.ravel(),
        lines={(a, b): _bent(nodes[a], nodes[b], float(np.clip(rng.normal(0.0, bend), -0.16, 0.16))) for a, b in edges},
        profiles=profiles,
        roundabouts=_roundabouts(rng, nodes, profiles),
    )


def _roundabouts(rng: np.random.Generator, nodes: Array, profiles: dict[Edge, Profile]) -> dict[int, Roundabout]:
    """Some crossings, with a paved circle that is wider than the streets that meet there."""
    found = {}
    for node, joined in neighbours(profiles).items():
        if len(joined) >= 3 and rng.random() < _ROUNDABOUTS:
            widest_m = max(profiles[min(node, other), max(node, other)].half_width_m for other in joined)
            outer_m = max(12.0, widest_m + float(rng.uniform(2.0, 5.0)))
            found[node] = Roundabout(nodes[node], outer_m - float(rng.uniform(7.5, 9.0)), outer_m)
    return found


def _regular(columns: int, rows: int) -> Array:
    """(columns · rows, 2) crossings at distances of 1, around the origin."""
    axes = [np.arange(n) - (n - 1) / 2 for n in (columns, rows)]
    return np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1).reshape(-1, 2)


def _irregular(rng: np.random.Generator, columns: int, rows: int) -> Array:
    """(columns · rows, 2) crossings: irregular distances with a mean of about 1, jitter, and two long waves."""
    axes = [np.cumsum(np.clip(np.exp(rng.normal(0.0, 0.25, n)), 0.6, 1.6)) for n in (columns, rows)]
    nodes = np.stack(np.meshgrid(axes[0] - axes[0].mean(), axes[1] - axes[1].mean(), indexing='ij'), axis=-1)
    nodes = nodes.reshape(-1, 2) + rng.uniform(-0.1, 0.1, (columns * rows, 2))
    for _ in range(2):
        direction, phase, length = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.0, 2 * np.pi), rng.uniform(4.0, 8.0)
        along = np.array([np.cos(direction), np.sin(direction)])
        wave = np.sin(nodes @ along * (2 * np.pi / length) + phase)
        nodes = nodes + rng.uniform(0.0, 0.3) * wave[:, None] * np.array([-along[1], along[0]])
    return nodes


def _turned(rng: np.random.Generator, nodes: Array) -> Array:
    turn = rng.uniform(0.0, 2 * np.pi)
    return np.asarray(nodes @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]))


def _thinned(rng: np.random.Generator, edges: list[Edge], inner: NDArray[np.bool_], remove: int) -> list[Edge]:
    """Edges without up to `remove` of them; all edges, and the inner ones alone, stay connected without dead ends."""
    kept = set(edges)
    for i in rng.permutation(len(edges)):
        left = kept - {edges[i]}
        if (
            remove
            and _connected(left, len(inner))
            and _connected({e for e in left if inner[list(e)].all()}, inner.sum())
        ):
            kept = left
            remove -= 1
    return sorted(kept)


def _connected(edges: set[Edge], nodes: int) -> bool:
    """Whether `edges` join `nodes` nodes to one network without dead ends."""
    joined = neighbours(edges)
    if len(joined) < nodes or min(map(len, joined.values())) < 2:
        return False
    first = next(iter(joined))
    seen, waiting = {first}, [first]
    while waiting:
        fresh = set(joined[waiting.pop()]) - seen
        seen |= fresh
        waiting += fresh
    return len(seen) == nodes


def _bent(start: Array, end: Array, bend: float) -> Array:
    """(M, 2) points about 4 m apart on a quadratic curve, at most `bend` / 2 of its length from the straight line."""
    control = (start + end) / 2 + bend * np.array([start[1] - end[1], end[0] - start[0]])
    t = np.linspace(0.0, 1.0, max(3, round(float(np.hypot(*(end - start))) / 4.0)))[:, None]
    return np.asarray((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end)
