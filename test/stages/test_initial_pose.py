"""A navigation stack is told where it is once, whenever the vehicle has been found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from offradar_ros.config import QueryConfig
from offradar_ros.stages.initial_pose import InitialPose
from offradar_ros.types import (
    Alignment,
    Candidate,
    Localisation,
    LocalisationState,
    Match,
    Outcome,
    Pose,
    Reason,
    Rejection,
)

CONFIG = QueryConfig()
ON, OFF, LOST, UNSURE = (
    LocalisationState.ON_MAP,
    LocalisationState.OFF_MAP,
    LocalisationState.LOST,
    LocalisationState.UNSURE,
)


def match(x_m: float = 0.0, yaw_rad: float = 0.5) -> Match:
    alignment = Alignment(np.array([1.0, 0.0, 0.1]), np.eye(3) * 0.01, 0.9)
    return Match(5, 1.0, 1.5, (Candidate(1, 0.1, 1.0, Pose(x_m, 0.0, 0.0, yaw_rad), alignment),))


def localised(state: LocalisationState, x_m: float = 0.0) -> Localisation:
    return Localisation(5, state, 0.9, 1, 0.9, np.array([x_m, 0.0]), np.eye(2))


def given(initial: InitialPose, outcome: Outcome, localisation: Localisation | None) -> bool:
    return initial.pose(outcome, localisation, CONFIG) is not None


def test_the_pose_is_that_of_the_vehicle() -> None:
    found = InitialPose().pose(match(), localised(ON), CONFIG)
    assert found is not None
    assert (found.pose.x_m, found.pose.yaw_rad) == pytest.approx((math.cos(0.5), 0.6))


@pytest.mark.parametrize('away', [OFF, LOST])
def test_it_is_given_once_until_the_vehicle_was_away(away: LocalisationState) -> None:
    initial = InitialPose()
    assert [given(initial, match(), localised(ON)) for _ in range(3)] == [True, False, False]
    assert not given(initial, match(), localised(UNSURE))
    assert not given(initial, match(), localised(ON))
    assert not given(initial, match(), localised(away))
    assert [given(initial, match(), localised(ON)) for _ in range(2)] == [True, False]


def test_it_is_given_again_when_it_is_asked_for() -> None:
    initial = InitialPose()
    assert given(initial, match(), localised(ON))
    initial.ask()
    assert [given(initial, match(), localised(ON)) for _ in range(2)] == [True, False]


@pytest.mark.parametrize(
    ('outcome', 'localisation'),
    [
        (match(), None),
        (match(), localised(UNSURE)),
        (match(), localised(ON, x_m=40.0)),
        (match(yaw_rad=math.nan), localised(ON)),
        (Rejection(5, Reason.UNVERIFIED, 1.0, 1.5, match().candidates, ''), localised(ON)),
    ],
    ids=['not localised', 'unsure', 'elsewhere', 'no heading', 'rejected'],
)
def test_a_pose_that_is_not_sound_is_waited_out(outcome: Outcome, localisation: Localisation | None) -> None:
    initial = InitialPose()
    assert not given(initial, outcome, localisation)
    assert given(initial, match(), localised(ON))
