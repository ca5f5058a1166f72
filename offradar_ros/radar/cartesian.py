"""Polar scan to the square, top-down image that the paper's backbone sees.

Convention: row 0 of the image is forward, columns grow to the right, the sensor is the centre of the image (the corner
shared by the four middle pixels where the side is even). Azimuth is clockwise from forward, so pixel (row i, column j)
is centred at forward ``(S/2 − i − 0.5) · resolution``, right ``(j + 0.5 − S/2) · resolution`` metres, and azimuth is
``atan2(right, forward)``. Range bin k is centred at ``range_offset + (k + 0.5) · range_resolution``.

Bins are several times finer than pixels: to sample one bin for each pixel would alias. Bins are therefore averaged
along range by an integer factor (area weights), sampled bilinearly at twice the image's resolution, and averaged two by
two.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import CartesianConfig
from offradar_ros.types import PolarScan

_FINER = 2
_ANGLE_STEPS = 1 << 16
# Neighbouring rows further apart than this many typical steps have a gap between them (one lost row is bridged).
_GAP_STEPS = 2.5
_OUTSIDE = -2.0


class PolarToCartesian:
    """Converts scans to images. Look-up tables are computed again only when the scan's geometry changes."""

    def __init__(self, config: CartesianConfig) -> None:
        self.config = config
        side = config.side_px * _FINER
        step_m = config.resolution_m / _FINER
        across_m = (np.arange(side) + 0.5 - side / 2) * step_m
        forward_m, right_m = -across_m[:, np.newaxis], across_m[np.newaxis, :]
        self._fine_step_m = step_m
        self._range_m = np.hypot(forward_m, right_m).astype(np.float32)
        turns = np.mod(np.arctan2(right_m, forward_m) / (2 * np.pi), 1.0)
        self._angle_index = (turns * _ANGLE_STEPS).astype(np.uint16)
        self._range_key: tuple[float, float, int] | None = None
        self._azimuth_key = b''
        self._order: NDArray[np.intp] | None = None

    def __call__(self, scan: PolarScan) -> NDArray[np.uint8]:
        """(S, S) uint8 mean power of each pixel; 0 nearer than `min_range_m`, beyond the last bin and in gaps."""
        self._prepare(scan)
        power = scan.power if self._order is None else scan.power[self._order]
        rows, bins = len(power), self._bins
        wrapped = np.empty((rows + 2, bins), np.uint8)
        cv2.resize(power[:, : bins * self._factor], (bins, rows), dst=wrapped[1:-1], interpolation=cv2.INTER_AREA)
        wrapped[0], wrapped[-1] = wrapped[-2], wrapped[1]
        fine = cv2.remap(wrapped, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        side = self.config.side_px
        return np.asarray(cv2.resize(fine, (side, side), interpolation=cv2.INTER_AREA), np.uint8)

    def _prepare(self, scan: PolarScan) -> None:
        """Compute the look-up tables again if the scan's geometry differs from that of the last one."""
        range_key = (scan.range_resolution_m, scan.range_offset_m, scan.power.shape[1])
        azimuth_key = scan.azimuths_rad.tobytes()
        if range_key == self._range_key and azimuth_key == self._azimuth_key:
            return
        if range_key != self._range_key:
            self._columns = self._range_table(*range_key)
        if azimuth_key != self._azimuth_key:
            self._rows = self._azimuth_table(scan.azimuths_rad)
        self._maps = cv2.convertMaps(self._columns, self._rows, cv2.CV_16SC2)
        self._range_key, self._azimuth_key = range_key, azimuth_key

    def _range_table(self, resolution_m: float, offset_m: float, range_bins: int) -> NDArray[np.float32]:
        """Column of the range-reduced image at each fine pixel; sets the reduction factor and the bins kept."""
        self._factor = min(max(1, int(self._fine_step_m / resolution_m)), range_bins)
        reduced_m = self._factor * resolution_m
        farthest_m = float(self._range_m.max()) - offset_m
        self._bins = min(range_bins // self._factor, max(1, math.ceil(farthest_m / reduced_m) + 1))
        column = (self._range_m - np.float32(offset_m)) / np.float32(reduced_m) - np.float32(0.5)
        seen = (column >= -0.5) & (column <= self._bins - 0.5) & (self._range_m >= self.config.min_range_m)
        return np.asarray(np.where(seen, np.clip(column, 0, self._bins - 1), _OUTSIDE), np.float32)

    def _azimuth_table(self, azimuths_rad: NDArray[np.float64]) -> NDArray[np.float32]:
        """Row of the wrapped image at each fine pixel; sets the order that sorts azimuths (None if sorted)."""
        order = np.argsort(azimuths_rad, kind='stable')
        self._order = None if np.all(order[1:] > order[:-1]) else order
        angles = azimuths_rad[order] / (2 * np.pi)
        rows = len(angles)
        around = np.concatenate([angles[-1:] - 1.0, angles, angles[:1] + 1.0])
        at = (np.arange(_ANGLE_STEPS) + 0.5) / _ANGLE_STEPS
        row = np.interp(at, around, np.arange(rows + 2))
        steps = np.diff(around)
        typical = float(np.median(steps[1:-1])) if rows > 1 else 1.0
        if steps.max() > _GAP_STEPS * typical:
            row = self._with_gaps(row, at, around, typical)
        return np.asarray(row.astype(np.float32)[self._angle_index], np.float32)

    @staticmethod
    def _with_gaps(
        row: NDArray[np.float64], at: NDArray[np.float64], around: NDArray[np.float64], typical: float
    ) -> NDArray[np.float64]:
        """`row`, set to outside the image where the angle `at` (turns) lies in a gap between the azimuths `around`."""
        steps = np.diff(around)
        before = np.clip(np.searchsorted(around, at, side='right') - 1, 0, len(steps) - 1)
        after_start, before_end = at - around[before], around[before + 1] - at
        in_gap = steps[before] > _GAP_STEPS * typical
        # A row covers half a step on each side, also where its neighbour is missing.
        row = np.where(in_gap, np.where(after_start < before_end, before, before + 1), row)
        return np.where(in_gap & (np.minimum(after_start, before_end) > 0.5 * typical), _OUTSIDE, row)
