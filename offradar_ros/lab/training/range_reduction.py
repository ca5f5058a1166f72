"""Scans made as small as the network's image allows."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan


def reduced_power(
    scan: PolarScan, step_m: float, reach_m: float, azimuths_rad: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """(A, B) uint8 area means along range of as many bins as fit into `step_m`, to `reach_m`.

    With half a pixel for the step and the image's corner for the reach this is the first thing that
    `offradar_ros.radar.cartesian` does, and its image stays the same in every bit. Row k is the scan's row nearest to
    `azimuths_rad` (A,).
    """
    factor = range_factor(scan.range_resolution_m, step_m)
    bins = math.ceil((reach_m - scan.range_offset_m) / (factor * scan.range_resolution_m)) + 1
    bins = max(1, min(scan.power.shape[1] // factor, bins))
    power = scan.power
    if not np.array_equal(scan.azimuths_rad, azimuths_rad):
        power = power[_nearest(scan.azimuths_rad, azimuths_rad)]
    return np.asarray(cv2.resize(power[:, : bins * factor], (bins, len(power)), interpolation=cv2.INTER_AREA), np.uint8)


def range_factor(resolution_m: float, step_m: float) -> int:
    """How many bins become one."""
    return max(1, int(step_m / resolution_m))


def _nearest(angles: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index of the nearest of `angles` to each of `wanted`, around the circle."""
    order = np.argsort(angles, kind='stable')
    around = np.concatenate([angles[order[-1:]] - math.tau, angles[order], angles[order[:1]] + math.tau])
    after = np.clip(np.searchsorted(around, wanted), 1, len(around) - 1)
    nearest = np.where(wanted - around[after - 1] <= around[after] - wanted, after - 1, after)
    return np.asarray(order[(nearest - 1) % len(order)], np.intp)
