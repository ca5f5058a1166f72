"""The position of a belief and that of an alignment: one, where they agree."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.belief.aligned_position import with_aligned_position
from offradar_ros.retrieval.vehicle_pose import VehiclePose
from offradar_ros.types import Localisation, LocalisationState, Pose

BELIEF = np.array([[9.0, 2.0], [2.0, 4.0]])
ALIGNED = np.array([[0.2, -0.05, 0.01], [-0.05, 0.1, 0.0], [0.01, 0.0, 0.002]])


def localisation(covariance_m2: NDArray[np.float64]) -> Localisation:
    state = LocalisationState.ON_MAP
    return Localisation(5, state, 0.99, 7, 0.98, np.array([100.0, -20.0]), covariance_m2)


def test_it_is_the_position_of_least_squares() -> None:
    """The information of both adds up: P⁺ = (P⁻¹ + Q⁻¹)⁻¹, x⁺ = P⁺ (P⁻¹ x + Q⁻¹ y)."""
    found = with_aligned_position(localisation(BELIEF), VehiclePose(Pose(104.0, -18.5, 0.0, 0.3), ALIGNED))
    of_belief, of_alignment = np.linalg.inv(BELIEF), np.linalg.inv(ALIGNED[:2, :2])
    covariance = np.linalg.inv(of_belief + of_alignment)
    expected = covariance @ (of_belief @ [100.0, -20.0] + of_alignment @ [104.0, -18.5])
    np.testing.assert_allclose(found.position_m, expected)
    np.testing.assert_allclose(found.covariance_m2, covariance)
    assert (np.linalg.eigvalsh(found.covariance_m2) > 0.0).all()
    before = localisation(BELIEF)
    assert (found.state, found.place_id, found.p_here, found.p_on_map) == (
        before.state,
        before.place_id,
        before.p_here,
        before.p_on_map,
    )


@pytest.mark.parametrize(('x_m', 'is_used'), [(109.0, True), (110.0, False), (400.0, False)])
def test_an_alignment_elsewhere_changes_nothing(x_m: float, is_used: bool) -> None:
    """3.03 standard deviations are the most: 9.2 m, for a variance of 9 m² of the belief and .2 of the alignment."""
    before = localisation(np.diag([9.0, 9.0]))
    found = with_aligned_position(before, VehiclePose(Pose(x_m, -20.0, 0.0, 0.3), np.diag([0.2, 0.2, 0.01])))
    assert (found is not before) == is_used


def test_between_walls_without_end_only_the_way_across_is_known() -> None:
    aligned = VehiclePose(Pose(108.0, -18.0, 0.0, 0.0), np.diag([100.0, 0.01, 0.001]))
    found = with_aligned_position(localisation(np.diag([9.0, 9.0])), aligned)
    np.testing.assert_allclose(found.position_m, [100.0 + 8.0 * 9.0 / 109.0, -18.0], atol=0.01)


def test_an_empty_map_has_no_position() -> None:
    empty = dataclasses.replace(localisation(np.full((2, 2), np.nan)), place_id=None, position_m=np.full(2, np.nan))
    assert with_aligned_position(empty, VehiclePose(Pose(0.0, 0.0, 0.0, 0.0), ALIGNED)) is empty
