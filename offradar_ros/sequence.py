"""One traversal of a radar: scans in time order and, where known, where the vehicle was."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import Trajectory
from offradar_ros.types import PolarScan


@runtime_checkable
class RadarSequence(Protocol):
    """What every source of recorded or simulated scans is."""

    @property
    def name(self) -> str:
        """What people call the traversal."""

    @property
    def layout(self) -> str:
        """The format it was read from."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64 scan stamps, never decreasing."""

    @property
    def trajectory(self) -> Trajectory | None:
        """The best positions there are, or None."""

    def __len__(self) -> int:
        """Number of scans, N."""

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, 0 to N − 1. DataError for a damaged one, RefusedInput for one without signal."""
