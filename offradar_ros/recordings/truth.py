"""Answers compared with the recorded poses of the vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.positions.headings import with_headings
from offradar_ros.types import Outcome

TOLERANCE_M = 25.0
"""A place within this of the scan is the right one (Sec. IV-C of the paper)."""


def true_poses(
    outcomes: Sequence[Outcome], trajectory: Trajectory, origin: GeoPoint | None, position: PositionConfig
) -> NDArray[np.float64]:
    """(N, 3) recorded east and north in metres and heading in rad, in the ``map`` frame, at each outcome's stamp.

    NaN where unknown. `origin` is where that frame starts; a trajectory in metres is taken to be in it already.
    `position` says between which positions is interpolated, and whose heading is taken.
    """
    if trajectory.geodetic and origin is None:
        return np.full((len(outcomes), 3), np.nan)
    max_gap_ns = round(position.max_gap_s * 1e9)
    metric = trajectory.in_frame(LocalFrame(origin) if origin else None)
    stamps_ns = np.array([outcome.stamp_ns for outcome in outcomes], np.int64)
    return with_headings(metric, position.heading, max_gap_ns).poses_at(stamps_ns, max_gap_ns)[:, [0, 1, 3]]


def errors_m(outcomes: Sequence[Outcome], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) metres from the best candidate, returned or withheld, to the true position.

    NaN where that is unknown, infinite where it is known and there is no candidate.
    """
    pairs = zip(outcomes, positions.tolist(), strict=True)
    return np.array([_error_m(outcome, x_m, y_m) for outcome, (x_m, y_m) in pairs], np.float64)


def _error_m(outcome: Outcome, x_m: float, y_m: float) -> float:
    if math.isnan(x_m) or not outcome.candidates:
        return math.nan if math.isnan(x_m) else math.inf
    pose = outcome.candidates[0].pose
    return math.hypot(pose.x_m - x_m, pose.y_m - y_m)


def on_map(positions: NDArray[np.float64], places_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether a map has a place within `TOLERANCE_M` of each of (N, 2) positions; false where it is unknown.

    `places_m` is (P, 2) or (P, 3), metres in the frame of the positions.
    """
    near = [(np.hypot(*(places_m[:, :2] - position).T) <= TOLERANCE_M).any() for position in positions]
    return np.array(near, np.bool_)


def recall_at_1(errors: NDArray[np.float64]) -> float:
    """Share of (N,) errors, metres, that are within `TOLERANCE_M`; unknown ones count as wrong. NaN without errors."""
    return float(np.mean(errors <= TOLERANCE_M)) if len(errors) else math.nan
