"""Where each scan of a sequence was made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.coverage import DEFAULT_MAX_GAP_NS, covered


def scan_positions(
    stamps_ns: NDArray[np.int64], trajectory: Trajectory, max_gap_ns: int = DEFAULT_MAX_GAP_NS
) -> NDArray[np.float64]:
    """(N, 3) float64 positions at (N,) int64 stamps, as the trajectory's are, linear between neighbours.

    NaN where `Trajectory.at` has no pose.
    """
    positions = np.full((len(stamps_ns), 3), np.nan)
    if not len(trajectory):
        return positions
    known = covered(stamps_ns, trajectory, max_gap_ns)
    # From the first stamp: float64 is exact to 104 days of nanoseconds.
    start_ns = trajectory.stamps_ns[0]
    asked, given = stamps_ns[known] - start_ns, trajectory.stamps_ns - start_ns
    for axis in range(3):
        positions[known, axis] = np.interp(asked, given, trajectory.positions[:, axis])
    return positions
