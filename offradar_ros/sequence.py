"""The interface of a sequence: the scans of one recording in time order and, if known, the positions."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import Trajectory
from offradar_ros.types import PolarScan


@runtime_checkable
class RadarSequence(Protocol):
    """A source of recorded or simulated scans."""

    @property
    def name(self) -> str:
        """Name of the recording, for people."""

    @property
    def layout(self) -> str:
        """Layout of the recording, such as ``oxford``."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64 scan stamps in nanoseconds, never decreasing."""

    @property
    def trajectory(self) -> Trajectory | None:
        """The most accurate positions of the recording, or None."""

    def __len__(self) -> int:
        """Number of scans, N."""

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, 0 to N − 1. DataError for a damaged one, RefusedInput for one without signal."""
