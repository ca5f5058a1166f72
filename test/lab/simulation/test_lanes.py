"""Lanes along routes: as far aside as wanted, where the road is wide enough."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.simulation.lanes import Lane, plan_lanes
from offradar_ros.lab.simulation.road import CLEARANCE_M, Road
from offradar_ros.lab.simulation.route import Route

STRAIGHT = Route(np.array([(0.0, 0.0), (300.0, 0.0)]), closed=False)
RING = Route(60.0 * np.column_stack([np.cos(t := np.linspace(0, 2 * np.pi, 40)[:-1]), np.sin(t)]), closed=True)
CELL_M = 0.5


def street(*blocked_m: tuple[float, float, float, float], half_m: float = 12.0) -> Road:
    """A road along x from 0 to 300 m, without blocks of (west, east, south, north)."""
    x, y = np.meshgrid(np.arange(-20.0, 320.0, CELL_M), np.arange(-40.0, 40.0, CELL_M))
    paved = np.abs(y) < half_m
    for west, east, south, north in blocked_m:
        paved &= ~((x >= west) & (x <= east) & (y >= south) & (y <= north))
    return Road(np.array([-20.0, -40.0]), CELL_M, paved.astype(np.uint8))


def offsets(lane: Lane) -> NDArray[np.float64]:
    """(M, 2) along and aside of the straight route."""
    return lane.line.at(np.arange(0.0, lane.line.length_m))[:, :2]


def test_on_a_wide_street_lanes_are_where_they_are_wanted_up_to_15_m_apart() -> None:
    left, right = plan_lanes(STRAIGHT, street(), (7.5, -7.5))
    np.testing.assert_allclose(offsets(left)[:, 1], 7.5, atol=1e-9)
    np.testing.assert_allclose(offsets(right)[:, 1], -7.5, atol=1e-9)


def test_on_a_narrow_street_lanes_stay_between_the_kerbs() -> None:
    (lane,) = plan_lanes(STRAIGHT, street(half_m=4.5), (-7.5,))
    assert np.abs(offsets(lane)[:, 1] + 4.5 - CLEARANCE_M).max() < 0.6


def test_a_lane_goes_smoothly_round_parked_cars_and_comes_back() -> None:
    (lane,) = plan_lanes(STRAIGHT, street((140.0, 160.0, -12.0, -4.0)), (-7.5,))
    x, y = offsets(lane).T
    assert np.all(y[(x > 138.0) & (x < 162.0)] > -4.0 + 1.0)
    np.testing.assert_allclose(y[(x < 80.0) | (x > 220.0)], -7.5, atol=1e-6)
    assert np.abs(np.diff(y)).max() < 0.15
    assert np.abs(np.diff(y, 2)).max() < 0.1
    headings = lane.line.at(np.arange(0.0, lane.line.length_m))[:, 2]
    np.testing.assert_allclose(headings[:-1], np.arctan2(np.diff(y), np.diff(x)), atol=0.05)


def test_medians_are_passed_on_the_right_and_on_either_side_by_outer_lanes() -> None:
    road = street((60.0, 240.0, -1.5, 1.5))
    middle, left, right = (offsets(lane) for lane in plan_lanes(STRAIGHT, road, (0.0, 3.5, -3.5)))
    beside = slice(70, 230)
    assert np.all(middle[beside, 1] < -1.5 - 1.4)
    assert np.all(left[beside, 1] > 2.9) and np.all(right[beside, 1] < -2.9)


def test_without_a_road_a_lane_is_exactly_aside() -> None:
    (lane,) = plan_lanes(STRAIGHT, None, (2.3,))
    np.testing.assert_allclose(offsets(lane)[:, 1], 2.3, atol=1e-9)


@pytest.mark.parametrize('left_m', [-6.0, 0.0, 6.0])
def test_a_closed_lane_is_driven_at_an_even_speed_without_a_seam(left_m: float) -> None:
    (lane,) = plan_lanes(RING, None, (left_m,))
    assert lane.line.length_m == pytest.approx(2 * np.pi * (60.0 - left_m), rel=0.02)
    poses = lane.line.at(np.arange(0.0, 2.2 * lane.line.length_m, 0.5))
    steps = np.diff(poses[:, :2], axis=0)
    np.testing.assert_allclose(np.hypot(*steps.T), 0.5, rtol=0.05)
    assert np.abs(np.angle(np.exp(1j * np.diff(poses[:, 2])))).max() < 0.05
    for arc_m in (0.0, 100.0, 800.0):
        here, beside = RING.at(np.array([arc_m]))[0], lane.line.at(np.array([lane.arc_m(arc_m)]))[0]
        assert np.hypot(*(here - beside)[:2]) == pytest.approx(abs(left_m), abs=0.3)


def test_inside_of_a_tight_curve_a_lane_does_not_turn_on_the_spot() -> None:
    corner = Route(np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 100.0)]), closed=False)
    (lane,) = plan_lanes(corner, None, (7.5,))
    headings = lane.line.at(np.arange(0.0, lane.line.length_m))[:, 2]
    assert np.abs(np.diff(headings)).max() < 0.4
    assert headings[-1] - headings[0] == pytest.approx(np.pi / 2, abs=0.05)
