"""A velocity and the pose that it leads to belong together."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.alignment.twist import Twist

SPEED, RATE, SECONDS = st.floats(-50.0, 50.0), st.floats(-2.0, 2.0), st.floats(0.05, 1.0)


@given(st.builds(Twist, SPEED, SPEED, RATE), SECONDS)
def test_the_velocity_between_poses_is_that_which_led_from_one_to_the_other(twist: Twist, seconds: float) -> None:
    found = Twist.between(twist.pose_after(seconds), seconds)
    assert found.forward_mps == pytest.approx(twist.forward_mps, abs=1e-3)
    assert found.left_mps == pytest.approx(twist.left_mps, abs=1e-3)
    assert found.yaw_radps == pytest.approx(twist.yaw_radps, abs=1e-9)


@given(st.builds(Twist, SPEED, SPEED, RATE), SECONDS)
def test_a_pose_is_where_many_small_steps_lead(twist: Twist, seconds: float) -> None:
    steps = 2000
    yaws = twist.yaw_radps * seconds * (np.arange(steps) + 0.5) / steps
    forward, left = twist.forward_mps * seconds / steps, twist.left_mps * seconds / steps
    expected = [
        float(np.sum(np.cos(yaws) * forward - np.sin(yaws) * left)),
        float(np.sum(np.sin(yaws) * forward + np.cos(yaws) * left)),
        twist.yaw_radps * seconds,
    ]
    np.testing.assert_allclose(twist.pose_after(seconds), expected, atol=1e-3)


def test_a_left_turn_of_a_quarter_circle() -> None:
    """Forward around a circle of 10 m, whose centre is to the left."""
    twist = Twist(5.0 * math.pi, 0.0, math.pi / 2.0)
    np.testing.assert_allclose(twist.pose_after(1.0), [10.0, 10.0, math.pi / 2.0])
    assert Twist.between(np.array([10.0, 10.0, math.pi / 2.0]), 1.0).left_mps == pytest.approx(0.0, abs=1e-9)
