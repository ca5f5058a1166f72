"""The pose of a vehicle, composed of that of a place and an alignment, with its covariance."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from offradar_ros.config import QueryConfig
from offradar_ros.retrieval.vehicle_pose import vehicle_pose
from offradar_ros.types import Alignment, Candidate, Pose

CONFIG = QueryConfig(place_sigma_m=0.8, place_sigma_deg=2.0, position_sigma_m=10.0)
SPREAD = np.array([[0.3, 0.05, 0.01], [0.05, 0.2, -0.02], [0.01, -0.02, 0.03]])
DRAWS = 40_000


def candidate(pose: Pose, alignment: Alignment | None) -> Candidate:
    return Candidate(7, 0.5, 1.0, pose, alignment)


@pytest.mark.parametrize('yaw_rad', [0.0, 1.0, -2.5, math.pi])
def test_the_covariance_is_that_of_draws(yaw_rad: float) -> None:
    covariance = SPREAD * 0.01
    place, relative = Pose(100.0, -50.0, 7.0, yaw_rad), np.array([6.0, -3.0, 0.4])
    found = vehicle_pose(candidate(place, Alignment(relative, covariance, 0.9)), CONFIG)
    rng = np.random.default_rng(3)
    of_place = np.array([place.x_m, place.y_m, place.yaw_rad]) + rng.normal(size=(DRAWS, 3)) * np.array(
        [0.8, 0.8, math.radians(2.0)]
    )
    drawn = rng.multivariate_normal(relative, covariance, DRAWS)
    turned = np.exp(1j * of_place[:, 2]) * (drawn[:, 0] + 1j * drawn[:, 1])
    poses = np.column_stack([of_place[:, 0] + turned.real, of_place[:, 1] + turned.imag, of_place[:, 2] + drawn[:, 2]])
    errors = poses - np.array([found.pose.x_m, found.pose.y_m, yaw_rad + 0.4])
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(np.cov(errors.T), found.covariance, atol=0.02)
    assert math.remainder(found.pose.yaw_rad - yaw_rad - 0.4, 2.0 * math.pi) == pytest.approx(0.0)
    assert -math.pi <= found.pose.yaw_rad <= math.pi
    assert found.pose.z_m == 7.0
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


@pytest.mark.parametrize(('sd_deg', 'used_deg'), [(0.2, 0.2), (8.0, 8.0), (math.nan, 2.0)])
def test_the_heading_of_a_place_is_as_certain_as_the_map_says(sd_deg: float, used_deg: float) -> None:
    """Or as the parameter, where the map does not say. Far from the place it moves the vehicle to the side."""
    place = Pose(1.0, 2.0, 3.0, 0.0, math.radians(sd_deg))
    found = vehicle_pose(candidate(place, Alignment(np.array([10.0, 0.0, 0.0]), np.zeros((3, 3)), 0.9)), CONFIG)
    variance = math.radians(used_deg) ** 2
    assert found.covariance[2, 2] == pytest.approx(variance)
    assert found.covariance[1, 1] == pytest.approx(0.8**2 + 100.0 * variance)
    assert found.covariance[0, 0] == pytest.approx(0.8**2)


def test_without_an_alignment_the_vehicle_is_near_the_place() -> None:
    found = vehicle_pose(candidate(Pose(1.0, 2.0, 3.0, 0.5), None), CONFIG)
    assert not found.has_heading
    assert (found.pose.x_m, found.pose.y_m, found.pose.z_m) == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(found.covariance, np.diag([100.0, 100.0, math.pi**2]))


@pytest.mark.parametrize(('score', 'least', 'taken'), [(0.3, 0.4, False), (0.4, 0.4, True), (-0.2, 0.0, False)])
def test_a_pose_at_which_the_scans_hardly_agree_is_not_taken(score: float, least: float, taken: bool) -> None:
    config = dataclasses.replace(CONFIG, min_pose_score=least)
    place, alignment = Pose(1.0, 2.0, 3.0, 0.5), Alignment(np.array([6.0, 8.0, 0.4]), SPREAD, score)
    found = vehicle_pose(candidate(place, alignment), config)
    assert found.has_heading == taken
    if not taken:
        without = vehicle_pose(candidate(place, None), config)
        assert found.pose.x_m == without.pose.x_m
        np.testing.assert_array_equal(found.covariance, without.covariance)


def test_at_a_place_without_heading_the_direction_of_the_shift_is_unknown() -> None:
    alignment = Alignment(np.array([6.0, 8.0, 0.4]), np.diag([0.25, 0.75, 0.1]), 0.9)
    found = vehicle_pose(candidate(Pose(1.0, 2.0), alignment), CONFIG)
    assert not found.has_heading
    assert (found.pose.x_m, found.pose.y_m) == (1.0, 2.0)
    # |t|² / 2 on each axis.
    np.testing.assert_allclose(found.covariance, np.diag([0.64 + 50.5, 0.64 + 50.5, math.pi**2]))
