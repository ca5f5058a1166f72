"""A drive as training and evaluation see it, whether it was simulated or recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """Scans and the truth about each; a `RadarSequence` without positions of its own.

    Attributes:
        name: what people call the drive.
        world: frame of `poses`; drives of two worlds are never near each other.
        key: names the scans in caches: all that they depend on is in it.
        stamps_ns: (N,) int64.
        poses: (N, 3) float64, x and y in metres of the world and heading in radians, NaN where unknown.
        driven_m: (N,) float64 metres driven before each scan.
        kinds: (N,) text, how each scan is degraded; empty for a clean scan, and where nothing is known.
        severities: (N,) float64, 0 for clean scans to 1, NaN where nothing is known.
        read_scan: scan i.
        layout: the format that scans were read from.
        group: of an evaluation's protocol.
        index: which of the world's drives, in an evaluation.
        mapped: whether an evaluation makes maps of it.
        queried: whether an evaluation searches for its scans.
    """

    name: str
    world: str
    key: str
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    driven_m: NDArray[np.float64]
    kinds: NDArray[np.str_]
    severities: NDArray[np.float64]
    read_scan: Callable[[int], PolarScan]
    layout: str = 'simulation'
    group: str = ''
    index: int = 0
    mapped: bool = True
    queried: bool = True
    trajectory: None = None

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, a copy; RefusedInput for one without signal, or that cannot be read."""
        return self.read_scan(index)


class DriveSource(Protocol):
    """Plain values that say how to get a drive; it is sent to other processes."""

    @property
    def name(self) -> str:
        """What its files are called."""

    @property
    def world(self) -> str:
        """Frame of its poses."""

    def settings(self) -> dict[str, Any]:
        """All that the scans depend on, as JSON has it; DataError where a file that it names cannot be read."""

    def open(self) -> Drive:
        """The drive, its scans rendered or read when they are asked for; DataError where it cannot be opened."""
