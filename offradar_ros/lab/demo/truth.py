"""Compares the answers of the demonstration with the recorded positions."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import GeoPoint
from offradar_ros.lab.demo.live import ReplayedDrive
from offradar_ros.recordings.road import trajectory_of
from offradar_ros.recordings.source import open_source
from offradar_ros.recordings.truth import TOLERANCE_M, errors_m, recall_at_1, true_positions
from offradar_ros.types import Match


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedDrive:
    """The N outcomes of one drive and the recorded positions.

    Attributes:
        replayed: the drive and its outcomes.
        positions_m: (N, 2) true positions in the map frame, NaN where unknown.
        errors_m: (N,) distance in metres from the best candidate, accepted or rejected, to the true position.
        accepted: (N,) whether the query was answered with a match.
        degraded: (N,) whether the scan was degraded by the simulation.
    """

    replayed: ReplayedDrive
    positions_m: NDArray[np.float64]
    errors_m: NDArray[np.float64]
    accepted: NDArray[np.bool_]
    degraded: NDArray[np.bool_]

    @property
    def nearest_is_right(self) -> NDArray[np.bool_]:
        """(N,) whether the best candidate is within `TOLERANCE_M`."""
        right: NDArray[np.bool_] = self.errors_m <= TOLERANCE_M
        return right

    def recall(self, chosen: NDArray[np.bool_]) -> float:
        """Recall@1 over the chosen outcomes; NaN over none."""
        return recall_at_1(self.errors_m[chosen])


def compare(replayed: ReplayedDrive, origin: GeoPoint) -> ComparedDrive:
    """Compare every outcome with the recorded position at its stamp; `origin` is that of the map."""
    trajectory = trajectory_of(open_source(replayed.drive.bag), replayed.drive.bag)
    positions_m = true_positions(replayed.outcomes, trajectory, origin, round(PositionConfig().max_gap_s * 1e9))
    return ComparedDrive(
        replayed,
        positions_m,
        errors_m(replayed.outcomes, positions_m),
        np.array([isinstance(o, Match) for o in replayed.outcomes], np.bool_),
        np.array([o.stamp_ns in replayed.drive.degraded_ns for o in replayed.outcomes], np.bool_),
    )
