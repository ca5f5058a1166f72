"""Draw docs/simulated_worlds.png: cities, and close-ups of what is in them; print how wide they are, and how alike."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from offradar_ros.lab.simulation.city import CityPlan, District, make_city
from offradar_ros.lab.simulation.picture import Panel, draw_worlds
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.streets import StreetKind
from offradar_ros.lab.simulation.traversal import Traversal
from offradar_ros.lab.simulation.world import World

Array = NDArray[np.float64]

OUT = Path(__file__).resolve().parents[1] / 'docs' / 'simulated_worlds.png'
CLOSE_M = 160.0
LANES_M = (-7.5, 0.0, 7.5)
CITIES = range(24)
MARGIN_M = 0.7
REPEATED_M = 60.0
"""Equal buildings that are farther apart than this are repeated; containers of one yard are nearer."""


def whole(title: str, plan: CityPlan) -> Panel:
    """A city with a drive of 150 s."""
    city = make_city(plan)
    return Panel(title, city, (SimulatedSequence(city, SessionPlan(seed=plan.seed, scans=600)).poses,))


def close(title: str, city: World, centre_m: Array) -> Panel:
    """A part of a city with whole laps in three lanes."""
    assert city.route is not None
    scans = round(1.05 * city.route.length_m / 2.0)
    drives = [SimulatedSequence(city, SessionPlan(scans=scans, left_m=left_m)).poses for left_m in LANES_M]
    return Panel(title, city, drives, CLOSE_M, centre_m)


def with_roundabout(seeds: Iterator[int]) -> tuple[World, Array]:
    """The first city whose route goes more than a third round an island of 5 m, and its centre."""
    for city in (make_city(CityPlan(seed=seed)) for seed in seeds):
        assert city.route is not None and city.streets is not None
        for roundabout in city.streets.roundabouts.values():
            around = city.route.points_m[np.hypot(*(city.route.points_m - roundabout.centre_m).T) < roundabout.outer_m]
            driven = len(around) / (2.0 * np.pi * roundabout.driven_m)
            if driven > 0.4 and roundabout.island_m > 5.0:
                return city, roundabout.centre_m
    raise AssertionError


def with_boulevard(seeds: Iterator[int]) -> tuple[World, Array]:
    """The first city whose route goes along a boulevard with a median of trees, and a point of it."""
    for city in (make_city(CityPlan(seed=seed)) for seed in seeds):
        assert city.route is not None and city.streets is not None
        for edge, profile in city.streets.profiles.items():
            middle = city.streets.lines[edge][len(city.streets.lines[edge]) // 2]
            on_route = np.hypot(*(city.route.points_m - middle).T).min() < 2.0
            leaves = np.hypot(*(city.vegetation.scatterers_m - middle).T) < CLOSE_M / 4
            if on_route and profile.kind is StreetKind.BOULEVARD and profile.median_m and leaves.sum() > 250:
                return city, middle
    raise AssertionError


def with_car_park(seeds: Iterator[int]) -> tuple[World, Array]:
    """The first city with 70 parking places within 30 m of one that is near the route, and that one."""
    for city in (make_city(CityPlan(seed=seed)) for seed in seeds):
        assert city.route is not None
        for place in city.parking[::5, :2]:
            near_route = np.hypot(*(city.route.points_m - place).T).min() < 45.0
            if near_route and np.count_nonzero(np.hypot(*(city.parking[:, :2] - place).T) < 30.0) > 70:
                return city, place
    raise AssertionError


def buildings(city: World) -> tuple[Array, Array]:
    """(B, 2) power and transmission, and (B, 2) first corner, of each closed outline of opaque walls."""
    seen = city.reflectors
    opaque = seen.wall_transmission < 0.1
    walls_m = seen.walls_m[opaque]
    first = np.r_[True, np.any(walls_m[1:, 0] != walls_m[:-1, 1], axis=1)]
    surfaces = np.column_stack([seen.wall_powers[opaque], seen.wall_transmission[opaque]])
    return surfaces[first], walls_m[first, 0]


def repeated(city: World) -> NDArray[np.bool_]:
    """(B,) whether each building occurs again, elsewhere."""
    surfaces, corners_m = buildings(city)
    _, group = np.unique(surfaces, axis=0, return_inverse=True)
    reach_m = [np.ptp(corners_m[group.ravel() == k], axis=0).max() for k in range(group.max() + 1)]
    return np.asarray(np.array(reach_m)[group.ravel()] > REPEATED_M)


def with_estate(seeds: Iterator[int]) -> tuple[World, Array]:
    """The first city with a regular grid whose route goes past many repeated buildings, and a point of the route."""
    for city in (make_city(CityPlan(seed=seed)) for seed in seeds):
        assert city.route is not None
        corners_m = buildings(city)[1][repeated(city)]
        for point in city.route.points_m[::20]:
            if np.count_nonzero(np.hypot(*(corners_m - point).T) < CLOSE_M / 2) > 28:
                return city, point
    raise AssertionError


def outer_lane(city: World, seed: int, reverse: bool) -> tuple[Array, int]:
    """(N, 3) poses of a lap in an outer lane with a car in every parking place, and how many of them are in one."""
    assert city.route is not None
    lap_s = city.route.length_m / SessionPlan().speed_mps
    drive = Traversal(SessionPlan(seed=seed, left_m=LANES_M[0], reverse=reverse, parked=1.0), city, lap_s)
    poses = drive.poses_at(np.arange(0.0, lap_s, 0.25))
    return poses, sum(not drive.parked.are_clear_of(point, MARGIN_M) for point in poses[:, :2])


def main() -> None:
    """Draw nine panels, and print what docs/training.md says of the worlds."""
    panels = [whole(f'city of seed {seed}', CityPlan(seed=seed)) for seed in (1, 2, 11)]
    dense = make_city(CityPlan(seed=4, districts=(District.DENSE,)))
    assert dense.route is not None
    panels += [
        close('a dense district', dense, dense.route.points_m[60]),
        close('a boulevard', *with_boulevard(itertools.count(1))),
        close('a roundabout', *with_roundabout(itertools.count(1))),
        close('a car park', *with_car_park(itertools.count(1))),
        close('repeated façades', *with_estate(itertools.count(1))),
    ]
    park = make_city(CityPlan(seed=3, districts=(District.PARK,)))
    assert park.route is not None
    near = cKDTree(park.vegetation.scatterers_m).query_ball_point(park.route.points_m, CLOSE_M / 3, return_length=True)
    panels.append(close('trees and hedges', park, park.route.points_m[np.argmax(near)]))
    draw_worlds(OUT, panels)
    print(f'{OUT}: drawn; close-ups have drives in lanes of {LANES_M} m')
    shares, apart_m, inside, scans = [], [], 0, 0
    for seed in CITIES:
        city = make_city(CityPlan(seed=seed))
        shares.append(repeated(city))
        there, back = (outer_lane(city, seed, reverse) for reverse in (False, True))
        apart_m.append(cKDTree(back[0][:, :2]).query(there[0][:, :2])[0])
        inside, scans = inside + there[1] + back[1], scans + len(there[0]) + len(back[0])
    most = np.mean([share.mean() > 0.5 for share in shares])
    print(f'{len(shares)} cities: {np.concatenate(shares).mean():.0%} of the buildings are repeated,')
    print(f'most of them in {most:.0%} of the cities')
    share, quantiles = np.concatenate(apart_m), (0.1, 0.25, 0.5, 0.75, 0.9)
    print('outer lanes of both directions, distance at 10, 25, 50, 75 and 90 % of the route:', end=' ')
    print(', '.join(f'{value:.1f} m' for value in np.quantile(share, quantiles)))
    print(f'{inside} of their {scans} scans are in a parked car, or within {MARGIN_M} m of one')


if __name__ == '__main__':
    main()
