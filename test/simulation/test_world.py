"""Towns from seeds."""

import dataclasses

import numpy as np
import pytest

from offradar_ros.simulation.world import TownPlan, make_town


def arrays(world):
    return [value for value in vars(world).values() if isinstance(value, np.ndarray)] + [world.route.points_m]


def test_a_seed_makes_one_town_and_another_seed_another():
    one, same, other = (make_town(TownPlan(seed=seed)) for seed in (4, 4, 5))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(arrays(one), arrays(same), strict=True))
    assert one.walls_m.shape != other.walls_m.shape or not np.array_equal(one.walls_m, other.walls_m)


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('closed', [True, False])
def test_the_road_is_free_and_built_along(seed, closed):
    town = make_town(TownPlan(seed=seed, blocks=(2, 2), closed=closed))
    along = np.linspace(0.0, 1.0, 25)[:, None, None]
    samples = ((1 - along) * town.walls_m[None, :, 0] + along * town.walls_m[None, :, 1]).reshape(-1, 2)
    distances = town.route.distance_to(samples)
    assert distances.min() > 2.5
    assert np.count_nonzero(distances < 20.0) > 100
    assert town.route.distance_to(town.parking[:, :2]).min() > 1.0


def test_walls_close_into_buildings_of_four():
    walls = make_town(TownPlan(seed=2)).walls_m.reshape(-1, 4, 2, 2)
    np.testing.assert_array_equal(walls[:, :, 1], np.roll(walls[:, :, 0], -1, axis=1))


def test_more_blocks_make_a_longer_route():
    plan = TownPlan(seed=1)
    assert make_town(dataclasses.replace(plan, blocks=(5, 4))).route.length_m > make_town(plan).route.length_m + 200.0
