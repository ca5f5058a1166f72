"""Routes as a function of arc length."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.lab.simulation.route import Route

SQUARE = np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 80.0), (0.0, 80.0)])


@pytest.mark.parametrize('closed', [True, False])
def test_arc_length_is_distance_driven_and_the_heading_follows_it(closed: bool) -> None:
    route = Route(SQUARE, closed)
    arc = np.linspace(0.0, route.length_m, 5000)
    poses = route.at(arc)
    steps = np.diff(poses[:, :2], axis=0)
    np.testing.assert_allclose(np.hypot(*steps.T), np.diff(arc), rtol=0.02)
    turn = np.angle(np.exp(1j * (np.arctan2(steps[:, 1], steps[:, 0]) - poses[:-1, 2])))
    assert np.abs(turn).max() < 0.1
    assert np.abs(np.diff(np.unwrap(poses[:, 2]))).max() < 0.05


def test_a_closed_route_repeats() -> None:
    route = Route(SQUARE, closed=True)
    assert 280.0 < route.length_m < 360.0
    arc = np.array([0.0, 12.0, 250.0])
    once, again = route.at(arc), route.at(arc + 3 * route.length_m)
    np.testing.assert_allclose(once[:, :2], again[:, :2], atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * once[:, 2]), np.exp(1j * again[:, 2]), atol=1e-6)


def test_an_open_route_stays_at_its_ends() -> None:
    route = Route(SQUARE, closed=False)
    np.testing.assert_allclose(route.at(np.array([-5.0, 1e6]))[:, :2], [(0.0, 0.0), (0.0, 80.0)], atol=1e-9)


def test_left_is_left_of_the_heading() -> None:
    route = Route(np.array([(0.0, 0.0), (50.0, 0.0)]), closed=False)
    np.testing.assert_allclose(route.at(np.array([20.0]), 3.0), [(20.0, 3.0, 0.0)], atol=1e-9)
