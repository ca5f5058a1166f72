"""Where a sequence's scans were made, for comparing sequences with one another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.scan_positions import scan_positions
from offradar_ros.sequence import RadarSequence


class Whereabouts(NamedTuple):
    """Attributes: the scans of one sequence.

    name: of the sequence's folder.
    positions: (N, 3) float64, a row a scan: latitude°, longitude°, altitude m, or metres; NaN where there is none.
    geodetic: whether they are latitudes and longitudes; else they are in a frame of the sequence's own.
    """

    name: str
    positions: NDArray[np.float64]
    geodetic: bool

    @property
    def known(self) -> NDArray[np.bool_]:
        """(N,) which scans have a position."""
        return np.asarray(np.isfinite(self.positions).all(axis=1))


def whereabouts(name: str, sequence: RadarSequence, max_gap_s: float) -> Whereabouts:
    """Positions between neighbours at most `max_gap_s` apart; none of a sequence whose position files are damaged."""
    try:
        trajectory = sequence.trajectory
    except DataError:
        trajectory = None
    if trajectory is None:
        return nowhere(name, len(sequence))
    positions = scan_positions(sequence.stamps_ns, trajectory, round(max_gap_s * 1e9))
    return Whereabouts(name, positions, trajectory.geodetic)


def nowhere(name: str, count: int = 0) -> Whereabouts:
    """`count` scans without a position."""
    return Whereabouts(name, np.full((count, 3), np.nan), geodetic=True)
