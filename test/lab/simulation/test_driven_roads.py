"""Nothing is in the way of a drive: not where cars park, nor kerbs, medians and islands."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.traffic import Traffic
from offradar_ros.lab.simulation.traversal import Traversal
from offradar_ros.lab.simulation.world import World
from offradar_ros.lab.training.config import DataConfig
from offradar_ros.lab.training.simulated_drives import LANES_M, city_drive

SEEDS = (1, 2, 3, 10_001, 10_002)
MARGIN_M = 0.7
"""Half the width of the radar's own vehicle is more: a radar nearer to a parked car than this is inside of it."""


@functools.cache
def city(seed: int) -> World:
    return make_city(CityPlan(seed=seed, blocks=(3, 3), route_m=1000.0))


def samples(seen: Reflectors) -> cKDTree:
    along = np.linspace(0.0, 1.0, 17)[:, None, None]
    walls = ((1 - along) * seen.walls_m[None, :, 0] + along * seen.walls_m[None, :, 1]).reshape(-1, 2)
    return cKDTree(np.concatenate([walls, seen.scatterers_m]))


@pytest.mark.parametrize('index', range(len(LANES_M)))
@pytest.mark.parametrize('seed', SEEDS)
def test_no_scan_of_training_is_in_a_parked_car_or_on_a_kerb(seed: int, index: int) -> None:
    """Also at crossings and roundabouts: a whole lap, with a car in every parking place."""
    world = city(seed)
    assert world.route is not None
    plan = dataclasses.replace(city_drive(seed, index, DataConfig()).plan, parked=1.0)
    seconds = np.arange(0.0, world.route.length_m / plan.speed_mps, 0.25)
    drive = Traversal(plan, world, float(seconds[-1]))
    poses = drive.poses_at(seconds)
    assert all(drive.parked.are_clear_of(point, MARGIN_M) for point in poses[:, :2])
    assert samples(world.reflectors).query(poses[:, :2])[0].min() > 1.0
    assert samples(world.vegetation).query(poses[:, :2])[0].min() > 0.8
    # No jumps, in place or in heading.
    steps_m = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert steps_m.max() < 1.3 * plan.speed_mps * 0.25 + 0.1
    assert np.abs(np.angle(np.exp(1j * np.diff(poses[:, 2])))).max() < 1.2


@pytest.mark.parametrize('seed', SEEDS)
def test_traffic_drives_between_parked_cars_kerbs_and_islands(seed: int) -> None:
    world = city(seed)
    assert world.route is not None
    plan = SessionPlan(seed=seed, parked=1.0, traffic=100.0)
    parked = Traversal(plan, world, 1.0).parked
    traffic = Traffic(plan, world.route, world.road)
    hard = samples(world.reflectors)
    for seconds in (0.0, 40.0):
        poses = traffic.poses_at(seconds)
        assert len(poses) > 90
        assert all(parked.are_clear_of(point, MARGIN_M) for point in poses[:, :2])
        assert hard.query(poses[:, :2])[0].min() > 0.8


def test_the_outer_lanes_of_both_directions_are_far_apart_where_there_is_room() -> None:
    apart_m = []
    for seed in SEEDS:
        world = city(seed)
        assert world.route is not None
        there, back = (
            Traversal(SessionPlan(left_m=-7.5, reverse=reverse), world, world.route.length_m / 8.0).poses_at(
                np.arange(0.0, world.route.length_m / 8.0, 0.25)
            )
            for reverse in (False, True)
        )
        apart_m.append(cKDTree(back[:, :2]).query(there[:, :2])[0])
    assert np.quantile(np.concatenate(apart_m), 0.95) > 14.0
    # At the corner of a crossing the lanes are a diagonal apart.
    assert np.concatenate(apart_m).max() < 15.0 * np.sqrt(2.0) + 2.0
