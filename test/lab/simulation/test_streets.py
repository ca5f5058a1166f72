"""The road network of a city: kinds of streets, regular grids and roundabouts."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.lab.simulation.city.lattice import make_streets
from offradar_ros.lab.simulation.city.plan import CityPlan
from offradar_ros.lab.simulation.random_route import make_route
from offradar_ros.lab.simulation.roundabout import Roundabout
from offradar_ros.lab.simulation.streets import StreetKind, Streets

PLAN = CityPlan()


def streets(seed: int, regular: bool = False) -> Streets:
    return make_streets(np.random.default_rng(seed), PLAN, regular)


def test_streets_are_narrow_ordinary_wide_and_open() -> None:
    profiles = [profile for seed in range(20) for profile in streets(seed).profiles.values()]
    widths = {kind: [p.half_width_m for p in profiles if p.kind is kind] for kind in StreetKind}
    assert all(len(found) > 0.03 * len(profiles) for found in widths.values())
    assert min(widths[StreetKind.NARROW]) < 4.3 and max(widths[StreetKind.NARROW]) <= 5.0
    assert max(widths[StreetKind.BOULEVARD]) > 17.0
    medians = [p for p in profiles if p.median_m]
    assert {p.kind for p in medians} == {StreetKind.BOULEVARD, StreetKind.OPEN_ROAD}
    assert all(p.half_width_m - p.median_m >= 9.0 for p in medians)


def test_an_avenue_has_one_kind_from_end_to_end() -> None:
    made = streets(3)
    rows = PLAN.blocks[1] + 3
    for row in range(rows):
        kinds = {p.kind for (a, b), p in made.profiles.items() if b - a == rows and a % rows == row}
        assert len(kinds) <= 1


def test_a_regular_grid_has_straight_streets_at_equal_distances() -> None:
    made = streets(5, regular=True)
    for line in made.lines.values():
        length_m = np.hypot(*(line[-1] - line[0]))
        assert length_m == pytest.approx(PLAN.block_m)
        assert np.sum(np.hypot(*np.diff(line, axis=0).T)) == pytest.approx(length_m)
    lengths = [np.hypot(*(line[-1] - line[0])) for line in streets(5).lines.values()]
    assert np.std(lengths) > 10.0


@pytest.mark.parametrize('degrees', [90, 180, 270])
def test_islands_are_passed_on_the_right_counter_clockwise(degrees: int) -> None:
    """From the west: a left turn goes three quarters round the island, a right turn one."""
    roundabout = Roundabout(np.array([100.0, 50.0]), 6.0, 14.0)
    before = np.column_stack([np.arange(0.0, 101.0, 4.0), np.full(26, 50.0)])
    angle = np.pi + np.radians(degrees)
    out = np.array([np.cos(angle), np.sin(angle)])
    after = roundabout.centre_m + np.arange(0.0, 101.0, 4.0)[:, None] * out
    line = roundabout.joined(before, after)
    np.testing.assert_allclose(line[[0, -1]], [before[0], after[-1]])
    offset = line - roundabout.centre_m
    assert np.hypot(*offset.T).min() > 9.5
    ring = np.hypot(*offset.T) < 10.5
    turned = np.unwrap(np.arctan2(*offset[ring].T[::-1]))
    assert turned[-1] - turned[0] == pytest.approx(np.radians(degrees), abs=0.02)
    assert np.all(np.diff(turned) > -0.01)


@pytest.mark.parametrize('closed', [True, False])
def test_no_route_crosses_an_island(closed: bool) -> None:
    passed = 0
    for seed in range(12):
        made = streets(seed)
        points = make_route(made, seed, 1500.0, closed).points_m
        for roundabout in made.roundabouts.values():
            nearest_m = np.hypot(*(points - roundabout.centre_m).T).min()
            passed += bool(nearest_m < roundabout.outer_m)
            assert nearest_m > roundabout.island_m
    assert passed > 5
