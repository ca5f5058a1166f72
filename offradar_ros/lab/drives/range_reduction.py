"""Scans reduced along range as far as the image of a network allows."""

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
    """Reduces scans along range to bins of at most `step_m`, up to `reach_m`."""

    step_m: float
    reach_m: float

    @classmethod
    def for_image(cls, config: NetworkConfig) -> Reduction:
        """Bins of half a pixel do not change a Cartesian image; those of half a column hardly change a polar one."""
        return cls(config.resolution_m / 2.0, config.reach_m)

    def __call__(self, scan: PolarScan) -> PolarScan:
        """The means along range over as many bins as fit into `step_m`.

        With half a pixel as the step and the corner of the image as the reach, this is the first step of
        `offradar_ros.radar.cartesian`, and its image is the same to the bit.
        """
        factor = max(1, int(self.step_m / scan.range_resolution_m))
        resolution_m = factor * scan.range_resolution_m
        bins = math.ceil((self.reach_m - scan.range_offset_m) / resolution_m) + 1
        bins = max(1, min(scan.power.shape[1] // factor, bins))
        joined = scan.power[:, : bins * factor]
        power = np.asarray(cv2.resize(joined, (bins, len(joined)), interpolation=cv2.INTER_AREA), np.uint8)
        return dataclasses.replace(scan, power=power, range_resolution_m=resolution_m)


def at_azimuths(scan: PolarScan, azimuths_rad: NDArray[np.float64]) -> PolarScan:
    """The scan whose row k is the row of `scan` nearest to (A,) `azimuths_rad`."""
    if np.array_equal(scan.azimuths_rad, azimuths_rad):
        return scan
    rows, stamps_ns = _nearest(scan.azimuths_rad, azimuths_rad), scan.azimuth_stamps_ns
    return dataclasses.replace(
        scan,
        power=scan.power[rows],
        azimuths_rad=azimuths_rad,
        azimuth_stamps_ns=None if stamps_ns is None else stamps_ns[rows],
    )


def _nearest(angles: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index of the nearest of `angles` to each of `wanted`, around the circle."""
    order = np.argsort(angles, kind='stable')
    around = np.concatenate([angles[order[-1:]] - math.tau, angles[order], angles[order[:1]] + math.tau])
    after = np.clip(np.searchsorted(around, wanted), 1, len(around) - 1)
    nearest = np.where(wanted - around[after - 1] <= around[after] - wanted, after - 1, after)
    return np.asarray(order[(nearest - 1) % len(order)], np.intp)
