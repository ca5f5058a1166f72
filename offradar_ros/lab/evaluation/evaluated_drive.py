"""A drive as evaluations see it, whether it was simulated or recorded."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan


@dataclasses.dataclass(frozen=True, eq=False)
class EvaluatedDrive:
    """Scans and the truth about each; a `RadarSequence` without positions of its own.

    Attributes:
        group: of the protocol.
        world: frame of `poses`; drives of one world are searched from each other.
        index: which of the world's drives.
        key: names the scans in caches: what they depend on is in it.
        stamps_ns: (N,) int64.
        poses: (N, 3) float64, x and y in metres of the world and heading in radians, NaN where unknown.
        driven_m: (N,) float64 way driven before each scan.
        kinds: (N,) text, what is wrong with each scan; empty where nothing is known to be.
        severities: (N,) float64, 0 for clean scans to 1, NaN where nobody knows.
        read_scan: scan i.
        title: what people call the drive.
        mapped: whether maps are made of it.
        queried: whether its scans are searched for.
    """

    group: str
    world: str
    index: int
    key: str
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    driven_m: NDArray[np.float64]
    kinds: NDArray[np.str_]
    severities: NDArray[np.float64]
    read_scan: Callable[[int], PolarScan]
    title: str = ''
    mapped: bool = True
    queried: bool = True
    layout: str = 'simulation'
    trajectory: None = None

    @property
    def name(self) -> str:
        """Title, or world and number of the drive."""
        return self.title or f'{self.world}_{self.index + 1}'

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, a copy; RefusedInput for one without signal, or that cannot be read."""
        return self.read_scan(index)
