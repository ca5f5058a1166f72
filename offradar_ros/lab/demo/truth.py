"""Answers against where the vehicle really was."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import GeoPoint
from offradar_ros.lab.demo.live import Driven
from offradar_ros.recordings.source import open_source
from offradar_ros.recordings.truth import TOLERANCE_M, errors_m, true_positions
from offradar_ros.types import Match

MAX_GAP_NS = 1_500_000_000


@dataclasses.dataclass(frozen=True, eq=False)
class Judged:
    """One drive's outcomes, row i one outcome.

    Attributes:
        positions_m: (N, 2) true positions in the map frame.
        nearest_is_right: (N,) whether the best candidate, returned or withheld, is within `TOLERANCE_M`.
        accepted: (N,) whether the query was answered with a match.
        spoiled: (N,) whether the scan was degraded by the simulation.
    """

    driven: Driven
    positions_m: NDArray[np.float64]
    nearest_is_right: NDArray[np.bool_]
    accepted: NDArray[np.bool_]
    spoiled: NDArray[np.bool_]

    def recall(self, chosen: NDArray[np.bool_]) -> float:
        """Recall@1 over the chosen outcomes; NaN over none."""
        return float(self.nearest_is_right[chosen].mean()) if chosen.any() else math.nan


def judge(driven: Driven, origin: GeoPoint) -> Judged:
    """Compare every outcome with the recorded position at its stamp."""
    trajectory = open_source(driven.drive.bag).trajectory
    if trajectory is None:
        raise ValueError(f'{driven.drive.name} has no positions')
    positions = true_positions(driven.outcomes, trajectory, origin, MAX_GAP_NS)
    return Judged(
        driven,
        positions,
        errors_m(driven.outcomes, positions) <= TOLERANCE_M,
        np.array([isinstance(o, Match) for o in driven.outcomes], np.bool_),
        np.array([o.stamp_ns in driven.drive.spoiled_ns for o in driven.outcomes], np.bool_),
    )
