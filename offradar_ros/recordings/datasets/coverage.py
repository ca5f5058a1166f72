"""How well positions cover the scans in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import Trajectory

DEFAULT_MAX_GAP_NS = round(PositionConfig().max_gap_s * 1e9)


def fraction_covered(
    stamps_ns: NDArray[np.int64], trajectory: Trajectory, max_gap_ns: int = DEFAULT_MAX_GAP_NS
) -> float:
    """Share of the stamps that have a pose, 0 to 1."""
    return float(np.mean(trajectory.covers(stamps_ns, max_gap_ns)))


def seconds_apart(stamps_ns: NDArray[np.int64], trajectory: Trajectory) -> float:
    """Seconds between the scans and the positions if they do not overlap in time; 0 if they do."""
    before = int(stamps_ns[0] - trajectory.stamps_ns[-1])
    after = int(trajectory.stamps_ns[0] - stamps_ns[-1])
    return max(before, after, 0) / 1e9
