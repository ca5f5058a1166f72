"""The index against a search of everything; vehicles against corners that are computed one at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from offradar_ros.lab.simulation.reflector_index import ReflectorIndex
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.vehicles import Vehicles


@pytest.mark.parametrize('range_m', [5.0, 60.0, 300.0])
def test_all_near_reflectors_and_few_others_are_found(range_m: float) -> None:
    rng = np.random.default_rng(0)
    starts, points = rng.uniform(-500.0, 500.0, (2000, 2)), rng.uniform(-500.0, 500.0, (3000, 2))
    walls = np.stack([starts, starts + rng.normal(0.0, 15.0, (2000, 2))], axis=1)
    world = Reflectors(walls, np.arange(2000.0), np.arange(2000.0) / 2000, points, np.arange(3000.0))
    around = ReflectorIndex(world)
    for centre in rng.uniform(-600.0, 600.0, (20, 2)):
        found = around.near(centre, range_m)
        shares = np.linspace(0.0, 1.0, 50)[:, None, None]
        nearest = np.hypot(*np.moveaxis((1 - shares) * walls[:, 0] + shares * walls[:, 1] - centre, -1, 0)).min(axis=0)
        assert set(np.flatnonzero(nearest < range_m)) <= set(found.wall_powers.astype(int))
        assert set(np.flatnonzero(np.hypot(*(points - centre).T) < range_m)) <= set(found.scatterer_powers.astype(int))
        for k, wall in zip(found.wall_powers.astype(int), found.walls_m, strict=True):
            np.testing.assert_array_equal(wall, walls[k])
        np.testing.assert_array_equal(found.wall_transmission, found.wall_powers / 2000)
        assert len(found.scatterer_powers) <= 3000 * ((2 * range_m + 60.0) / 1000.0) ** 2 * 2 + 30


def test_an_empty_world_has_nothing_near() -> None:
    empty = Reflectors(np.empty((0, 2, 2)), np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0))
    found = ReflectorIndex(empty).near(np.zeros(2), 50.0)
    assert len(found.walls_m) == len(found.scatterers_m) == 0


def test_a_vehicle_is_a_closed_box_of_its_size() -> None:
    vehicles = Vehicles(np.random.default_rng(1), 30, vans=0.3, lorries=0.3)
    poses = np.random.default_rng(2).uniform(-50.0, 50.0, (30, 3))
    made = vehicles.reflectors(poses)
    boxes = made.walls_m.reshape(30, 4, 2, 2)
    np.testing.assert_array_equal(boxes[:, :, 1], np.roll(boxes[:, :, 0], -1, axis=1))
    for box, (x, y, heading), (length, width) in zip(boxes, poses.tolist(), vehicles.sizes_m.tolist(), strict=True):
        for (along, left), corner in zip(((-1, -1), (1, -1), (1, 1), (-1, 1)), box[:, 0], strict=True):
            a, b = along * length / 2, left * width / 2
            expected = (
                x + a * math.cos(heading) - b * math.sin(heading),
                y + a * math.sin(heading) + b * math.cos(heading),
            )
            np.testing.assert_allclose(corner, expected, atol=1e-9)
    assert made.wall_transmission.max() <= 0.5 and len(np.unique(made.wall_transmission)) == 3
    points = made.scatterers_m.reshape(30, -1, 2)
    assert np.all(np.hypot(*(points - poses[:, None, :2]).transpose(2, 0, 1)) <= np.hypot(*vehicles.sizes_m.T)[:, None])


def test_vehicles_that_are_near_the_radar_are_found() -> None:
    vehicles = Vehicles(np.random.default_rng(1), 4, vans=0.0, lorries=0.0)
    poses = np.array([(0.0, 0.0, 0.3), (10.0, 0.0, 0.0), (0.0, 3.5, 0.0), (0.5, 0.5, 2.0)])
    assert vehicles.do_not_contain(np.zeros(2), poses, 0.7).tolist() == [False, True, True, False]
    assert vehicles.do_not_contain(np.zeros(2), poses, 3.0).tolist() == [False, True, False, False]
