"""A drive for training and evaluation, simulated or recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """Scans with the ground truth of each; a `RadarSequence` without a trajectory.

    Attributes:
        name: name of the drive.
        world: frame of `poses`; drives of two worlds are never near each other.
        key: key of the scans in caches; it depends on everything that the scans depend on.
        stamps_ns: (N,) int64.
        poses: (N, 3) float64, x and y in metres of the world and heading in radians, NaN where unknown.
        driven_m: (N,) float64, metres driven before each scan.
        kinds: (N,) text, how each scan is degraded; empty for a clean scan, and where that is unknown.
        severities: (N,) float64, 0 for clean scans to 1, NaN where unknown.
        read_scan: returns scan i.
        layout: format from which the scans were read.
        group: group of the world in the protocol of an evaluation.
        index: number of the drive in its world, in an evaluation.
        mapped: whether an evaluation makes maps from it.
        queried: whether an evaluation uses its scans as queries.
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
    """Values from which a drive can be opened; it is sent to other processes."""

    @property
    def name(self) -> str:
        """Name of its files."""

    @property
    def world(self) -> str:
        """Frame of its poses."""

    def settings(self) -> dict[str, Any]:
        """All that the scans depend on, as values for JSON; DataError if a file that it uses cannot be read."""

    def open(self) -> Drive:
        """The drive, whose scans are rendered or read on demand; DataError if it cannot be opened."""
