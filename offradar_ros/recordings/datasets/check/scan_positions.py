"""Positions of a sequence's scans, for comparing sequences with one another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.sequence import RadarSequence


class ScanPositions(NamedTuple):
    """Positions of the N scans of one sequence.

    Attributes:
        name: of the sequence's folder.
        positions: (N, 3) float64 latitude°, longitude°, altitude m, or metres; NaN for a scan without a position.
        geodetic: whether they are latitudes and longitudes; else they are metres in a frame of this sequence.
    """

    name: str
    positions: NDArray[np.float64]
    geodetic: bool

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) which scans have a position."""
        return np.asarray(np.isfinite(self.positions).all(axis=1))


def scan_positions(name: str, sequence: RadarSequence, max_gap_s: float) -> ScanPositions:
    """Positions between neighbours at most `max_gap_s` apart; none of a sequence whose position files are damaged."""
    try:
        trajectory = sequence.trajectory
    except DataError:
        trajectory = None
    if trajectory is None:
        return no_positions(name, len(sequence))
    positions = trajectory.poses_at(sequence.stamps_ns, round(max_gap_s * 1e9))[:, :3]
    return ScanPositions(name, positions, trajectory.geodetic)


def no_positions(name: str, count: int = 0) -> ScanPositions:
    """`count` scans without a position."""
    return ScanPositions(name, np.full((count, 3), np.nan), geodetic=True)
