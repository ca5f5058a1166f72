"""What agrees with a scan at a pose elsewhere speaks against an answer; what puts the vehicle there, too, does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from offradar_ros.retrieval.rival_alignments import scores_elsewhere
from offradar_ros.types import Alignment, Candidate, Pose


def candidate(
    x_m: float, y_m: float, yaw_rad: float, relative: tuple[float, float, float] | None, score: float = 0.5
) -> Candidate:
    alignment = None if relative is None else Alignment(np.array(relative), np.eye(3), score)
    return Candidate(1, 0.1, 1.0, Pose(x_m, y_m, 0.0, yaw_rad), alignment)


def test_places_around_one_vehicle_are_no_rivals_whatever_their_headings() -> None:
    """The vehicle is at (10, 0), heading north: three places see it ahead, behind, and beside an oncoming lane."""
    north = math.pi / 2.0
    seen = [
        candidate(10.0, -5.0, north, (5.0, 0.0, 0.0), 0.8),
        candidate(10.0, 5.0, north, (-5.0, 0.0, 0.0), 0.6),
        candidate(7.0, 1.0, -north, (1.0, 3.0, math.pi), 0.7),
    ]
    assert scores_elsewhere(seen).tolist() == [0.0, 0.0, 0.0]


def test_the_best_one_elsewhere_counts_for_each() -> None:
    here, there, far = (candidate(x_m, 0.0, 0.0, (0.0, 0.0, 0.0), s) for x_m, s in ((0, 0.8), (5, 0.6), (500, 0.3)))
    assert scores_elsewhere([here, there, far]).tolist() == [0.6, 0.8, 0.8]
    assert scores_elsewhere([here, far]).tolist() == [0.3, 0.8]


def test_the_same_spot_with_another_heading_is_elsewhere() -> None:
    seen = [candidate(0.0, 0.0, 0.0, (0.0, 0.0, yaw), 0.5) for yaw in (0.0, 0.02, math.pi)]
    assert scores_elsewhere(seen).tolist() == [0.5, 0.5, 0.5]
    assert scores_elsewhere(seen[:2]).tolist() == [0.0, 0.0]


def test_what_is_not_aligned_or_does_not_agree_is_no_rival() -> None:
    here = candidate(0.0, 0.0, 0.0, (0.0, 0.0, 0.0), 0.5)
    assert scores_elsewhere([here, candidate(90.0, 0.0, 0.0, None)]).tolist() == [0.0, 0.0]
    assert scores_elsewhere([here, candidate(90.0, 0.0, 0.0, (0.0, 0.0, 0.0), -0.1)]).tolist() == [0.0, 0.5]
    assert scores_elsewhere([]).tolist() == []


@pytest.mark.parametrize('unknown', [0, 1])
def test_without_a_heading_only_what_cannot_be_the_same_spot_is_elsewhere(unknown: int) -> None:
    yaws = [math.nan if number == unknown else 0.0 for number in range(2)]
    near = [candidate(x_m, 0.0, yaw, (5.0, 0.0, 0.0)) for x_m, yaw in zip((0.0, 9.0), yaws, strict=True)]
    far = [candidate(x_m, 0.0, yaw, (5.0, 0.0, 0.0)) for x_m, yaw in zip((0.0, 13.0), yaws, strict=True)]
    assert scores_elsewhere(near).tolist() == [0.0, 0.0]
    assert scores_elsewhere(far).tolist() == [0.5, 0.5]
