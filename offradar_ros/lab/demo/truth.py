"""Compares the answers of the demonstration with the recorded positions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import GeoPoint
from offradar_ros.lab.demo.live import ReplayedDrive
from offradar_ros.recordings.road import trajectory_of
from offradar_ros.recordings.source import open_source
from offradar_ros.recordings.truth import TOLERANCE_M, errors_m, true_poses
from offradar_ros.types import Match


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedDrive:
    """The N outcomes of one drive and the recorded positions.

    Attributes:
        replayed: the drive and its outcomes.
        positions_m: (N, 2) true positions in the map frame, NaN where unknown.
        errors_m: (N,) distance in metres from the best candidate, accepted or rejected, to the true position.
        on_map: (N,) whether the map that was searched has a place within `TOLERANCE_M` of the true position.
        accepted: (N,) whether the query was answered with a match.
        paper_accepts: (N,) whether the paper's rule, a threshold on U alone, answers with the best candidate.
        p_right: (N,) the reported probability that the best candidate is right; NaN if there is none.
        degraded: (N,) whether the scan was degraded by the simulation.
        states: (N,) text, the state of the belief over all scans up to this one (`LocalisationState`); empty if none
            was received.
        p_on_map: (N,) its probability that the vehicle is on the map; NaN if none was received.
    """

    replayed: ReplayedDrive
    positions_m: NDArray[np.float64]
    errors_m: NDArray[np.float64]
    on_map: NDArray[np.bool_]
    accepted: NDArray[np.bool_]
    paper_accepts: NDArray[np.bool_]
    p_right: NDArray[np.float64]
    degraded: NDArray[np.bool_]
    states: NDArray[np.str_]
    p_on_map: NDArray[np.float64]

    @property
    def searched(self) -> bool:
        """Whether there was a map to search."""
        return len(self.replayed.places) > 0

    @property
    def off_map(self) -> NDArray[np.bool_]:
        """(N,) whether there is a map, but no place of it near: each answer is wrong."""
        return ~self.on_map & self.searched

    @property
    def nearest_is_right(self) -> NDArray[np.bool_]:
        """(N,) whether the best candidate is within `TOLERANCE_M`."""
        right: NDArray[np.bool_] = self.errors_m <= TOLERANCE_M
        return right


def compare(replayed: ReplayedDrive, origin: GeoPoint) -> ComparedDrive:
    """Compare every outcome with the recorded position at its stamp; `origin` is that of the map."""
    outcomes = replayed.outcomes
    trajectory = trajectory_of(open_source(replayed.drive.bag), replayed.drive.bag)
    positions_m = true_poses(outcomes, trajectory, origin, PositionConfig())[:, :2]
    localisations = [replayed.localisations.get(outcome.stamp_ns) for outcome in outcomes]
    to_places_m = cdist(positions_m, replayed.places.positions_m[:, :2])
    return ComparedDrive(
        replayed,
        positions_m,
        errors_m(outcomes, positions_m),
        np.any(to_places_m <= TOLERANCE_M, axis=1),
        np.array([isinstance(o, Match) for o in outcomes], np.bool_),
        np.array([bool(o.candidates) and o.uncertainty <= o.threshold for o in outcomes], np.bool_),
        np.array([o.p_right for o in outcomes], np.float64),
        np.array([o.stamp_ns in replayed.drive.degraded_ns for o in outcomes], np.bool_),
        np.array([found.state.value if found else '' for found in localisations], np.str_),
        np.array([found.p_on_map if found else math.nan for found in localisations], np.float64),
    )
