"""Distances between the positions of scans."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.drives.drive import Drive

_BLOCK = 512


def distances_m(some: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S, O) metres between (S, 2) and (O, 2) positions."""
    east, north = (np.subtract.outer(some[:, axis], others[:, axis]) for axis in (0, 1))
    east *= east
    north *= north
    east += north
    return np.asarray(np.sqrt(east, out=east))


def nearest_m(one: Drive, other: Drive) -> float:
    """The least distance in metres between a scan of one drive and a scan of the other."""
    blocks = range(0, len(one), _BLOCK)
    return min(float(distances_m(one.poses[start : start + _BLOCK, :2], other.poses[:, :2]).min()) for start in blocks)
