"""A detour leaves the route of the other drives, and comes back to it."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from offradar_ros.errors import ConfigError
from offradar_ros.lab.drives.detour import with_detour
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.world import World

DRIVEN_M = 800.0
TOLERANCE_M = 25.0


@functools.cache
def city(seed: int) -> World:
    return make_city(CityPlan(seed=seed))


def driven(world: World) -> NDArray[np.float64]:
    assert world.route is not None
    return world.route.at(np.arange(0.0, DRIVEN_M))


@pytest.mark.parametrize('seed', [1, 2, 3, 4])
@pytest.mark.parametrize('length_m', [150.0, 250.0])
def test_it_leaves_the_driven_road_once_and_comes_back(seed: int, length_m: float) -> None:
    old, new = driven(city(seed)), driven(with_detour(city(seed), DRIVEN_M, length_m))
    off = cKDTree(old[:, :2]).query(new[:, :2])[0] > TOLERANCE_M
    assert off.sum() > length_m - 2 * TOLERANCE_M - 20.0
    assert np.count_nonzero(np.diff(off.astype(int))) == 2
    assert not off[:40].any()
    assert not off[-30:].any()


@pytest.mark.parametrize('seed', [1, 2, 3, 4])
def test_it_follows_streets_without_jumps_or_turning_round(seed: int) -> None:
    world = with_detour(city(seed), DRIVEN_M, 250.0)
    poses = driven(world)
    assert world.streets is not None
    streets = cKDTree(np.concatenate(list(world.streets.lines.values())))
    assert streets.query(poses[:, :2])[0].max() < 10.0
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() < 1.1
    turned = np.unwrap(poses[:, 2])
    assert np.abs(turned[10:] - turned[:-10]).max() < 2.6


def test_only_the_route_is_another() -> None:
    world, again = (with_detour(city(3), DRIVEN_M, 250.0) for _ in range(2))
    assert world.reflectors is city(3).reflectors
    assert world.parking is city(3).parking
    np.testing.assert_array_equal(driven(world), driven(again))


def test_without_such_a_detour_it_is_refused() -> None:
    with pytest.raises(ConfigError, match=r'no detour of 900 m .* 800 m of the route: try a shorter one'):
        with_detour(city(3), DRIVEN_M, 900.0)
    with pytest.raises(ConfigError, match='expected a city'):
        with_detour(dataclasses.replace(city(3), streets=None), DRIVEN_M, 100.0)
