"""Simulated cities."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from offradar_ros.errors import ConfigError
from offradar_ros.lab.simulation.city import CityPlan, District, make_city
from offradar_ros.lab.simulation.random_route import make_route
from offradar_ros.lab.simulation.reflectors import concatenate
from offradar_ros.lab.simulation.world import World

SMALL = CityPlan(seed=1, blocks=(2, 2), route_m=400.0)


def arrays(world: World) -> list[NDArray[np.float64]]:
    assert world.route is not None
    assert world.road is not None
    seen = concatenate(world.reflectors, world.vegetation)
    return [*dataclasses.astuple(seen), world.parking, world.route.points_m, world.road.free.astype(float)]


def test_the_same_seed_makes_the_same_city_and_another_seed_another() -> None:
    one, same, other = (make_city(dataclasses.replace(SMALL, seed=seed)) for seed in (4, 4, 5))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(arrays(one), arrays(same), strict=True))
    assert one.reflectors.walls_m.shape != other.reflectors.walls_m.shape


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('district', list(District))
def test_the_road_is_free_and_objects_stand_along_it(seed: int, district: District) -> None:
    city = make_city(dataclasses.replace(SMALL, seed=seed, districts=(district,)))
    assert city.road is not None and city.route is not None
    seen = concatenate(city.reflectors, city.vegetation)
    along = np.linspace(0.0, 1.0, 9)[:, None, None]
    samples = ((1 - along) * seen.walls_m[None, :, 0] + along * seen.walls_m[None, :, 1]).reshape(-1, 2)
    assert not city.road.is_free(samples).any()
    assert not city.road.is_free(seen.scatterers_m).any()
    assert not city.road.is_free(city.parking[:, :2]).any()
    near = cKDTree(city.route.points_m).query(seen.scatterers_m)[0]
    assert np.count_nonzero(near < 25.0) > 50


def test_outlines_of_buildings_are_closed() -> None:
    """No street cuts a building: every corner joins two walls."""
    seen = make_city(dataclasses.replace(SMALL, districts=(District.INDUSTRIAL,))).reflectors
    solid = seen.walls_m[seen.wall_transmission < 0.1]
    starts, ends = ({(round(x, 6), round(y, 6)) for x, y in solid[:, end].tolist()} for end in (0, 1))
    assert len(solid) > 50 and starts == ends


def test_districts_differ_in_buildings_and_vegetation() -> None:
    def counts(district: District) -> tuple[int, int]:
        city = make_city(dataclasses.replace(SMALL, districts=(district,)))
        solid = (city.reflectors.wall_transmission < 0.1) & (city.reflectors.wall_powers > 1e4)
        return int(solid.sum()), len(city.vegetation.scatterers_m)

    (dense, _), (_, park_leaves), (open_, open_leaves) = (
        counts(kind) for kind in (District.DENSE, District.PARK, District.OPEN)
    )
    assert dense > 5 * open_
    assert park_leaves > 2 * open_leaves


def test_cities_of_one_kind_differ() -> None:
    counts = [
        len(make_city(dataclasses.replace(SMALL, seed=seed, districts=(District.DENSE,))).reflectors.wall_powers)
        for seed in range(4)
    ]
    assert max(counts) > 1.15 * min(counts)


@pytest.mark.parametrize('closed', [True, False])
@pytest.mark.parametrize('min_length_m', [0.0, 1000.0, 3000.0])
def test_routes_are_long_enough_and_have_no_u_turns(closed: bool, min_length_m: float) -> None:
    streets = make_city(SMALL).streets
    assert streets is not None
    for seed in range(6):
        route = make_route(streets, seed, min_length_m, closed)
        assert route.closed == closed
        # Rounded corners are shorter.
        assert route.length_m > 0.9 * min_length_m
        poses = route.at(np.arange(0.0, route.length_m, 2.0))
        turns = np.angle(np.exp(1j * np.diff(poses[:, 2])))
        assert np.abs(turns).max() < 0.6


def test_routes_are_surrounded_by_the_city() -> None:
    city = make_city(SMALL)
    assert city.streets is not None
    for seed in range(4):
        points = make_route(city.streets, seed, 1500.0).points_m
        reach = np.concatenate([city.reflectors.scatterers_m, city.vegetation.scatterers_m])
        assert np.all(points.min(axis=0) > reach.min(axis=0) + 60.0)
        assert np.all(points.max(axis=0) < reach.max(axis=0) - 60.0)


def test_some_cities_have_car_parks_away_from_the_kerb() -> None:
    most = 0
    for seed in range(4):
        city = make_city(dataclasses.replace(SMALL, seed=seed, districts=(District.INDUSTRIAL,)))
        places = cKDTree(city.parking[:, :2])
        # Along a kerb there are seven within 20 m on each side.
        most = max(most, *(len(found) for found in places.query_ball_point(city.parking[:, :2], 20.0)))
    assert most > 40


def outlines(world: World) -> dict[tuple[float, float], list[NDArray[np.float64]]]:
    """Walls of each building, by power and transmission."""
    seen = world.reflectors
    found: dict[tuple[float, float], list[NDArray[np.float64]]] = {}
    for wall, power, transmission in zip(seen.walls_m, seen.wall_powers, seen.wall_transmission, strict=True):
        if transmission < 0.1:
            found.setdefault((float(power), float(transmission)), []).append(wall)
    return found


def test_estates_repeat_one_building_and_other_districts_none() -> None:
    """Of equal power are only the walls of one building, of the containers of a yard, or of an estate."""
    repeated, corners = 0, 0
    for seed in range(8):
        for walls in outlines(make_city(dataclasses.replace(SMALL, seed=seed))).values():
            corners += len(walls)
            lengths = np.hypot(*(np.array(walls)[:, 1] - np.array(walls)[:, 0]).T)
            if np.ptp(np.array(walls)[:, 0], axis=0).max() > 90.0:
                repeated += len(walls)
                # Each length occurs once, or twice, in each of many buildings.
                distinct = np.unique(np.round(lengths, 6))
                assert len(distinct) < len(lengths) / 3
    assert 0.05 < repeated / corners < 0.4


def best_copy(world: World) -> float:
    """Largest share of the corners of buildings along a street that are found again along a parallel one."""
    assert world.streets is not None
    seen, lines = world.reflectors, list(world.streets.lines.values())
    corners = seen.walls_m[seen.wall_transmission < 0.1, 0]
    everywhere, best = cKDTree(corners), 0.0
    for one in lines:
        beside = corners[cKDTree(one).query(corners, distance_upper_bound=35.0)[0] < 35.0]
        for moved in (other[0] - one[0] for other in lines if other is not one and parallel(one, other)):
            if len(beside) > 40:
                best = max(best, float((everywhere.query(beside + moved)[0] < 0.05).mean()))
    return best


def parallel(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Whether two streets have the same direction and length."""
    return bool(np.hypot(*((other[-1] - other[0]) - (one[-1] - one[0]))) < 1.0)


def test_in_a_regular_grid_parallel_streets_may_be_copies() -> None:
    suburb = dataclasses.replace(SMALL, seed=100, districts=(District.SUBURB,))
    assert best_copy(make_city(suburb)) > 0.75
    assert best_copy(make_city(dataclasses.replace(suburb, seed=101))) < 0.2


@pytest.mark.parametrize('wrong', [{'blocks': (0, 2)}, {'block_m': 3.0}, {'districts': ()}, {'route_m': -1.0}])
def test_a_plan_outside_its_bounds_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match='of a city: expected'):
        CityPlan(**wrong)
