"""How well positions cover the scans in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import Trajectory

DEFAULT_MAX_GAP_NS = round(PositionConfig().max_gap_s * 1e9)
_LONGEST_PAUSE_NS = 86400 * 10**9


def fraction_covered(
    stamps_ns: NDArray[np.int64], trajectory: Trajectory, max_gap_ns: int = DEFAULT_MAX_GAP_NS
) -> float:
    """Share of the stamps that have a pose, 0 to 1."""
    return float(np.mean(trajectory.covers(stamps_ns, max_gap_ns)))


def span_ns(stamps_ns: NDArray[np.int64]) -> tuple[int, int]:
    """Earliest and latest of (N,) stamps in any order, N > 0, without those of a clock that was not set.

    Such stamps are more than a day from all others: the largest group counts, and of two as large the later one.
    """
    ordered = np.sort(stamps_ns)
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > _LONGEST_PAUSE_NS) + 1)
    largest = max(reversed(groups), key=len)
    return int(largest[0]), int(largest[-1])


def seconds_apart(stamps_ns: NDArray[np.int64], trajectory: Trajectory) -> float:
    """Seconds between the scans, in any order, and the positions if they do not overlap in time; 0 if they do."""
    first_ns, last_ns = span_ns(stamps_ns)
    before = first_ns - int(trajectory.stamps_ns[-1])
    after = int(trajectory.stamps_ns[0]) - last_ns
    return max(before, after, 0) / 1e9
