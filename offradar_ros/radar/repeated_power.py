"""Scans that a driver or a recording repeats under another stamp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan


class RepeatedPower:
    """Tells whether a scan holds the very power of the one before, byte for byte, which noise makes impossible."""

    def __init__(self) -> None:
        self._before: NDArray[np.uint8] | None = None

    def is_repeated(self, scan: PolarScan) -> bool:
        """Whether the next scan repeats the one before."""
        before, self._before = self._before, scan.power
        return before is not None and np.array_equal(before, scan.power)
