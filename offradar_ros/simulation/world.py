"""A town made from a seed: what a radar sees in it, and a route through it.

Convention: metres east and north of the town's origin. Powers are linear and say how strong a return from 10 m is,
seen face on, with the receiver's noise at 1.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.simulation.route import Route

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class TownPlan:
    """What a town is made from.

    Attributes:
        seed: the same seed makes the same town.
        blocks: blocks that the route goes round, east and north.
        block_m: distance between streets, metres.
        closed: whether the route is a loop or a staircase from one corner of those blocks to the other.
    """

    seed: int = 0
    blocks: tuple[int, int] = (3, 2)
    block_m: float = 90.0
    closed: bool = True


@dataclasses.dataclass(frozen=True, eq=False)
class World:
    """Attributes: walls, which also hide what is behind them, small scatterers, and where cars may stand.

    walls_m: (W, 2, 2) float64, ends of each wall.
    wall_powers: (W,) float64.
    scatterers_m: (S, 2) float64, poles and parts of trees.
    scatterer_powers: (S,) float64.
    parking: (K, 3) float64, x, y and heading of each place to park.
    route: what traversals follow.
    """

    walls_m: Array
    wall_powers: Array
    scatterers_m: Array
    scatterer_powers: Array
    parking: Array
    route: Route


def make_town(plan: TownPlan) -> World:
    """Streets on an uneven lattice, one block more on every side than the route goes round."""
    rng = np.random.default_rng(plan.seed)
    columns, rows = plan.blocks[0] + 3, plan.blocks[1] + 3
    nodes = np.stack(np.meshgrid(np.arange(columns), np.arange(rows), indexing='ij'), axis=-1) * plan.block_m
    nodes = nodes + rng.uniform(-0.15, 0.15, nodes.shape) * plan.block_m
    streets = [(nodes[i, j], nodes[i + 1, j]) for i in range(columns - 1) for j in range(rows)]
    streets += [(nodes[i, j], nodes[i, j + 1]) for i in range(columns) for j in range(rows - 1)]
    sides = [_street_side(rng, *ends) for street in streets for ends in (street, street[::-1])]
    walls, wall_powers, scatterers, scatterer_powers, parking = (
        np.concatenate(parts) for parts in zip(*sides, strict=True)
    )
    route = Route(np.array([nodes[i, j] for i, j in _route_nodes(plan)]), plan.closed)
    free = _buildings_off_the_streets(walls, streets)
    return World(walls[free], wall_powers[free], scatterers, scatterer_powers, parking, route)


def _route_nodes(plan: TownPlan) -> list[tuple[int, int]]:
    east, north = plan.blocks
    if not plan.closed:
        steps = [(1 + (k + 1) // 2, 1 + k // 2) for k in range(east + north + 1)]
        return [(min(i, east + 1), min(j, north + 1)) for i, j in steps]
    south = [(i, 1) for i in range(1, east + 1)]
    right = [(east + 1, j) for j in range(1, north + 1)]
    top = [(i, north + 1) for i in range(east + 1, 1, -1)]
    left = [(1, j) for j in range(north + 1, 1, -1)]
    return south + right + top + left


def _street_side(rng: np.random.Generator, start: Array, end: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Everything on the left of the street from `start` to `end`: walls and powers, scatterers and powers, parking."""
    length = float(np.hypot(*(end - start)))
    forward = (end - start) / length
    left = np.array([-forward[1], forward[0]])
    built_up, green = rng.uniform(0.3, 1.0), rng.uniform(0.0, 1.0)

    def place(along: Array, aside: Array) -> Array:
        return np.asarray(start + along[..., None] * forward + aside[..., None] * left)

    walls, wall_powers, scatterers, powers = [np.empty((0, 2, 2))], [], [np.empty((0, 2))], [np.empty(0)]
    along = 14.0
    while along < length - 20.0:
        width, depth, setback = rng.uniform(7.0, 24.0), rng.uniform(8.0, 15.0), rng.uniform(8.0, 14.0)
        width = min(width, length - 14.0 - along)
        if rng.random() < built_up:
            corners = place(along + width * np.array([0, 1, 1, 0]), setback + depth * np.array([0, 0, 1, 1]))
            walls.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
            wall_powers += [_from_decibels(rng.uniform(50.0, 66.0))] * 4
        elif rng.random() < green:
            centre = place(np.array(along + width / 2), np.array(rng.uniform(7.0, 20.0)))
            scatterers.append(centre + rng.normal(0.0, 1.2, (16, 2)))
            powers.append(_from_decibels(rng.uniform(30.0, 46.0, 16)))
        along += width + (rng.uniform(2.0, 10.0) if rng.random() < 0.5 else 0.0)
    poles = np.arange(rng.uniform(5.0, 20.0), length, rng.uniform(18.0, 35.0))
    scatterers.append(place(poles, np.full(len(poles), 6.0) + rng.normal(0.0, 0.3, len(poles))))
    powers.append(_from_decibels(rng.uniform(44.0, 58.0, len(poles))))
    spots = np.arange(18.0, length - 18.0, 6.5) if rng.random() < 0.6 else np.empty(0)
    headings = np.full(len(spots), np.arctan2(forward[1], forward[0]))
    parking = np.column_stack([place(spots, np.full(len(spots), 4.8)), headings])
    return np.concatenate(walls), np.array(wall_powers), np.concatenate(scatterers), np.concatenate(powers), parking


def _buildings_off_the_streets(walls: Array, streets: list[tuple[Array, Array]]) -> NDArray[np.bool_]:
    """(W,) whether a wall belongs to a building that keeps 6 m from the middle of every street."""
    corners = walls[:, 0]
    nearest = np.full(len(corners), np.inf)
    for start, end in streets:
        along = np.clip((corners - start) @ (end - start) / np.sum((end - start) ** 2), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(*(corners - start - along[:, None] * (end - start)).T))
    return np.repeat(nearest.reshape(-1, 4).min(axis=1) > 6.0, 4)


def _from_decibels(decibels: Array | float) -> Array:
    return np.asarray(10.0 ** (np.asarray(decibels) / 10.0))
