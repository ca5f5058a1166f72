"""An EKF that treats messages as robot_localization's ekf_node does follows a vehicle by the recipe in params."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray

from offradar_ros.config import QueryConfig
from offradar_ros.ros.outcome_message import match_pose_message
from offradar_ros.types import Alignment, Candidate, Match, Pose

RECIPE: dict[str, Any] = yaml.safe_load(Path('params/robot_localization.yaml').read_text())['ekf_map'][
    'ros__parameters'
]
# x, y, yaw and their velocities among the fifteen variables of the filter.
STATE = [0, 1, 5, 6, 7, 11]
SPEED_MPS, RADIUS_M, STEP_S, STEPS_A_SCAN = 8.0, 60.0, 0.05, 5
SCANS = 400
QUERY = QueryConfig()
Array = NDArray[np.float64]


class Ekf:
    """Planar, with the rules of robot_localization for a measurement.

    Values that are not finite are left out, a variance is made positive and at least 1e-9, angles of the innovation are
    wrapped, and nothing is taken whose Mahalanobis distance is at least the rejection threshold.
    """

    def __init__(self) -> None:
        self.state = np.zeros(6)
        self.covariance = np.diag(np.array(RECIPE['initial_estimate_covariance'], float)[STATE])
        self._noise = np.diag(np.array(RECIPE['process_noise_covariance'], float)[STATE])

    def predict(self, seconds: float) -> None:
        """Constant velocity in the frame of the vehicle."""
        _, _, yaw, vx, vy, vyaw = self.state
        cos, sin = math.cos(yaw), math.sin(yaw)
        self.state = self.state + seconds * np.array([cos * vx - sin * vy, sin * vx + cos * vy, vyaw, 0.0, 0.0, 0.0])
        jacobian = np.eye(6)
        jacobian[0, 2:5] = seconds * np.array([-sin * vx - cos * vy, cos, -sin])
        jacobian[1, 2:5] = seconds * np.array([cos * vx - sin * vy, sin, cos])
        jacobian[2, 5] = seconds
        self.covariance = jacobian @ self.covariance @ jacobian.T + seconds * self._noise

    def correct(self, which: list[int], measured: Array, covariance: Array, threshold: float = math.inf) -> bool:
        """Whether the measurement is taken."""
        kept = [row for row, value in enumerate(measured.tolist()) if math.isfinite(value)]
        rows = [which[row] for row in kept]
        spread = covariance[np.ix_(kept, kept)].copy()
        np.fill_diagonal(spread, np.maximum(np.abs(np.diag(spread)), 1e-9))
        observe = np.eye(6)[rows]
        innovation = measured[kept] - self.state[rows]
        innovation = np.where(np.array(rows) == 2, np.angle(np.exp(1j * innovation)), innovation)
        inverse = np.linalg.inv(observe @ self.covariance @ observe.T + spread)
        if innovation @ inverse @ innovation >= threshold**2:
            return False
        gain = self.covariance @ observe.T @ inverse
        left = np.eye(6) - gain @ observe
        self.state = self.state + gain @ innovation
        self.state[2] = math.remainder(self.state[2], 2.0 * math.pi)
        self.covariance = left @ self.covariance @ left.T + gain @ spread @ gain.T
        return True

    def take_pose(self, message: PoseWithCovarianceStamped, threshold: float) -> bool:
        """A pose of `match_pose`."""
        pose, orientation = message.pose.pose.position, message.pose.pose.orientation
        yaw = 2.0 * math.atan2(orientation.z, orientation.w)
        covariance = np.array(message.pose.covariance).reshape(6, 6)[np.ix_([0, 1, 5], [0, 1, 5])]
        return self.correct([0, 1, 2], np.array([pose.x, pose.y, yaw]), covariance, threshold)


@dataclasses.dataclass(frozen=True)
class Drive:
    """Errors in metres after the first ten scans, and how many wrong poses there were and how many were taken."""

    errors_m: Array
    wrong: int
    wrong_taken: int


def truth(seconds: float) -> Array:
    """A circle, driven counter-clockwise."""
    angle = SPEED_MPS * seconds / RADIUS_M
    return np.array([RADIUS_M * math.sin(angle), -RADIUS_M * math.cos(angle), angle])


def match_at(seconds: float, rng: np.random.Generator, *, wrong: bool, aligned: bool) -> PoseWithCovarianceStamped:
    """A match with a place some metres away, whose own position is wrong by as much as the configuration says."""
    vehicle, place = truth(seconds), truth(seconds - rng.uniform(-0.6, 0.6))
    if wrong:
        place[:2] += rng.uniform(8.0, 25.0) * np.array([math.cos(angle := rng.uniform(0.0, 6.28)), math.sin(angle)])
        place[2] += rng.uniform(-math.pi, math.pi)
        vehicle = place
    cos, sin = math.cos(place[2]), math.sin(place[2])
    away = vehicle[:2] - place[:2]
    relative = np.array([cos * away[0] + sin * away[1], cos * away[1] - sin * away[0], vehicle[2] - place[2]])
    covariance = np.diag([0.1, 0.1, math.radians(0.3)]) ** 2
    alignment = Alignment(rng.multivariate_normal(relative, covariance), covariance, 0.7) if aligned else None
    mapped = place + rng.normal(size=3) * [
        QUERY.place_sigma_m,
        QUERY.place_sigma_m,
        math.radians(QUERY.place_sigma_deg),
    ]
    candidate = Candidate(1, 0.1, 1.0, Pose(mapped[0], mapped[1], 0.0, mapped[2]), alignment)
    return match_pose_message(Match(round(seconds * 1e9), 1.0, 2.0, (candidate,), 0.99, None), QUERY)


def drive(threshold: float, share_wrong: float = 0.05, share_unaligned: float = 0.1) -> Drive:
    rng, ekf = np.random.default_rng(4), Ekf()
    errors, wrong_count, taken = [], 0, 0
    for step in range(SCANS * STEPS_A_SCAN):
        seconds = (step + 1) * STEP_S
        ekf.predict(STEP_S)
        # Odometry of a vehicle whose wheels are two per cent smaller than it thinks.
        measured = np.array([1.02 * SPEED_MPS, 0.0, SPEED_MPS / RADIUS_M]) + rng.normal(size=3) * [0.05, 0.02, 0.005]
        ekf.correct([3, 4, 5], measured, np.diag([0.05, 0.02, 0.005]) ** 2)
        if (step + 1) % STEPS_A_SCAN:
            continue
        wrong = step > 10 * STEPS_A_SCAN and rng.random() < share_wrong
        message = match_at(seconds, rng, wrong=wrong, aligned=wrong or rng.random() >= share_unaligned)
        accepted = ekf.take_pose(message, threshold)
        wrong_count, taken = wrong_count + wrong, taken + (wrong and accepted)
        if step > 10 * STEPS_A_SCAN:
            errors.append(float(np.hypot(*(ekf.state[:2] - truth(seconds)[:2]))))
    return Drive(np.array(errors), wrong_count, taken)


def test_the_recipe_takes_position_and_heading_of_a_match() -> None:
    assert RECIPE['pose0'] == 'match_pose'
    assert [number for number, used in enumerate(RECIPE['pose0_config']) if used] == [0, 1, 5]
    assert len(RECIPE['pose0_config']) == len(RECIPE['odom0_config']) == 15
    assert len(RECIPE['initial_estimate_covariance']) == len(RECIPE['process_noise_covariance']) == 15
    assert (RECIPE['world_frame'], RECIPE['map_frame']) == ('map', 'map')


@pytest.mark.parametrize('yaw_rad', [math.nan, 0.0, 3.1])
@pytest.mark.parametrize('score', [None, 0.1, 0.8])
def test_every_match_is_a_measurement_that_the_filter_takes_as_it_is(yaw_rad: float, score: float | None) -> None:
    """With nothing left out, made positive or enlarged; and a rotation of unit length, whatever is known."""
    spread = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.001], [0.0, 0.001, 0.0004]])
    alignment = None if score is None else Alignment(np.array([3.0, -1.0, 0.2]), spread, score)
    candidate = Candidate(1, 0.1, 1.0, Pose(10.0, -20.0, 3.0, yaw_rad), alignment)
    message = match_pose_message(Match(1, 1.0, 2.0, (candidate,), 0.99, None), QUERY)
    assert message.header.frame_id == RECIPE['world_frame']
    orientation = message.pose.pose.orientation
    values = [orientation.x, orientation.y, orientation.z, orientation.w]
    assert np.linalg.norm(values) == pytest.approx(1.0)
    covariance = np.array(message.pose.covariance).reshape(6, 6)
    assert np.isfinite(covariance).all()
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 1e-9
    assert Ekf().take_pose(message, RECIPE['pose0_rejection_threshold'])


def test_the_vehicle_is_followed_and_wrong_matches_are_rejected() -> None:
    found = drive(RECIPE['pose0_rejection_threshold'])
    assert found.wrong > 10
    assert found.wrong_taken <= 0.1 * found.wrong
    assert np.median(found.errors_m) < 0.6
    assert np.quantile(found.errors_m, 0.99) < 2.0
    # Without the threshold the wrong ones are taken, and carry it away.
    trusting = drive(math.inf)
    assert trusting.wrong_taken == trusting.wrong
    assert np.quantile(trusting.errors_m, 0.99) > 2.0 * np.quantile(found.errors_m, 0.99)


def test_a_heading_that_is_not_known_does_not_turn_the_vehicle() -> None:
    """Nothing is aligned: the filter has only positions, with the wide covariance that they come with."""
    found = drive(RECIPE['pose0_rejection_threshold'], share_wrong=0.0, share_unaligned=1.0)
    assert np.median(found.errors_m) < 5.0
