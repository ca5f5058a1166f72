"""Answers compared with recorded positions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.recordings.truth import errors_m, on_map, recall_at_1, true_poses
from offradar_ros.types import Candidate, Match, Outcome, Pose, Reason, Rejection

SECOND = 10**9
POSITION = PositionConfig(max_gap_s=2.0)
ORIGIN = GeoPoint(51.75, -1.25, 70.0)


def track(*, geodetic: bool) -> Trajectory:
    """10 m a second eastwards for 3 s, then nothing for 4 s."""
    metres = np.array([[0.0, 5, 0], [10, 5, 0], [20, 5, 0], [30, 5, 0], [70, 5, 0]])
    positions = LocalFrame(ORIGIN).to_geodetic(metres) if geodetic else metres
    return Trajectory(np.array([0, 1, 2, 3, 7]) * SECOND, positions, np.full(5, np.nan), geodetic=geodetic)


def answers(stamps_s: list[float], x_m: float | None) -> list[Outcome]:
    """Matches to a place at (x, 5), or rejections without a candidate."""
    if x_m is None:
        return [Rejection(round(s * SECOND), Reason.MAP_EMPTY, 1.0, 1.0, (), '') for s in stamps_s]
    found = (Candidate(1, 0.5, 1.0, Pose(x_m, 5.0)),)
    return [Match(round(s * SECOND), 1.0, 1.0, found) for s in stamps_s]


@pytest.mark.parametrize('geodetic', [False, True])
def test_positions_are_interpolated_and_not_extrapolated(geodetic: bool) -> None:
    outcomes = answers([-1.0, 0.0, 1.25, 5.0, 8.0], 0.0)
    found = true_poses(outcomes, track(geodetic=geodetic), ORIGIN if geodetic else None, POSITION)
    expected = [[math.nan] * 3, [0.0, 5.0, 0.0], [12.5, 5.0, 0.0], [math.nan] * 3, [math.nan] * 3]
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert true_poses([], track(geodetic=geodetic), ORIGIN, POSITION).shape == (0, 3)


@pytest.mark.parametrize('geodetic', [False, True])
def test_a_heading_is_measured_or_that_of_the_way(geodetic: bool) -> None:
    recorded = dataclasses.replace(track(geodetic=geodetic), yaws_rad=np.array([3.0, -3.1, -3.0, -2.9, -2.8]))
    origin = ORIGIN if geodetic else None
    for choice, expected in (('auto', (3.0 - 3.1 + 2 * math.pi) / 2), ('course', 0.0), ('none', math.nan)):
        position = PositionConfig(max_gap_s=2.0, heading=choice)
        (found,) = true_poses(answers([0.5], 0.0), recorded, origin, position)
        np.testing.assert_allclose(np.exp(1j * found[2]), np.exp(1j * expected), atol=1e-4)


def test_a_frame_without_an_origin_has_no_truth() -> None:
    assert np.isnan(true_poses(answers([1.0], 0.0), track(geodetic=True), None, POSITION)).all()


def test_errors_are_of_the_best_candidate() -> None:
    outcomes = [*answers([0.0, 1.0, 9.0], 25.0), *answers([0.0, 9.0], None)]
    errors = errors_m(outcomes, true_poses(outcomes, track(geodetic=False), None, POSITION)[:, :2])
    np.testing.assert_array_equal(errors, [25.0, 15.0, math.nan, math.inf, math.nan])
    assert recall_at_1(errors) == pytest.approx(2 / 5)
    assert recall_at_1(errors[:2]) == 1.0
    assert math.isnan(recall_at_1(errors[:0]))


def test_a_position_is_on_the_map_within_the_tolerance_of_a_place() -> None:
    places_m = np.array([[0.0, 0.0, 5.0], [100.0, 0.0, 5.0]])
    positions = np.array([[25.0, 0.0], [26.0, 0.0], [100.0, 20.0], [math.nan, math.nan]])
    assert on_map(positions, places_m).tolist() == [True, False, True, False]
    assert on_map(positions, places_m[:0]).tolist() == [False] * 4
