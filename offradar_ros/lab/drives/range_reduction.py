"""Scans made as small as a network's image allows."""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.types import PolarScan


@dataclasses.dataclass(frozen=True)
class Reduction:
    """What scans are reduced to along range: bins as long as fit into `step_m`, to `reach_m`."""

    step_m: float
    reach_m: float

    @classmethod
    def for_image(cls, config: NetworkConfig) -> Reduction:
        """Half a pixel leaves a Cartesian image as it is; half a column of a polar one hardly changes it."""
        return cls(config.resolution_m / 2.0, config.reach_m)

    def __call__(self, scan: PolarScan) -> PolarScan:
        """The area means along range of as many bins as fit into `step_m`.

        With half a pixel for the step and the image's corner for the reach this is the first thing that
        `offradar_ros.radar.cartesian` does, and its image stays the same in every bit.
        """
        factor = max(1, int(self.step_m / scan.range_resolution_m))
        resolution_m = factor * scan.range_resolution_m
        bins = math.ceil((self.reach_m - scan.range_offset_m) / resolution_m) + 1
        bins = max(1, min(scan.power.shape[1] // factor, bins))
        joined = scan.power[:, : bins * factor]
        power = np.asarray(cv2.resize(joined, (bins, len(joined)), interpolation=cv2.INTER_AREA), np.uint8)
        return dataclasses.replace(scan, power=power, range_resolution_m=resolution_m)


def at_azimuths(scan: PolarScan, azimuths_rad: NDArray[np.float64]) -> PolarScan:
    """The scan whose row k is the one nearest to `azimuths_rad` (A,) of `scan`; stamps of rows are left out."""
    if np.array_equal(scan.azimuths_rad, azimuths_rad):
        return scan
    power = scan.power[_nearest(scan.azimuths_rad, azimuths_rad)]
    return dataclasses.replace(scan, power=power, azimuths_rad=azimuths_rad, azimuth_stamps_ns=None)


def _nearest(angles: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index of the nearest of `angles` to each of `wanted`, around the circle."""
    order = np.argsort(angles, kind='stable')
    around = np.concatenate([angles[order[-1:]] - math.tau, angles[order], angles[order[:1]] + math.tau])
    after = np.clip(np.searchsorted(around, wanted), 1, len(around) - 1)
    nearest = np.where(wanted - around[after - 1] <= around[after] - wanted, after - 1, after)
    return np.asarray(order[(nearest - 1) % len(order)], np.intp)
