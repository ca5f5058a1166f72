"""Polar scan to the polar image that the compact encoder sees: a grid of equal azimuth sectors and range intervals.

Convention: row k of the image is the mean over azimuths from k to k + 1 sectors clockwise from forward, column j over
ranges from j to j + 1 times `resolution_m` from the sensor. A turn of the sensor by a whole
sector is a roll of the rows.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PolarGridConfig
from offradar_ros.types import PolarScan

# A row of a scan covers half a step on each side; where rows are missing, at most this many typical steps in total.
_WIDEST_STEPS = 2.5


class PolarToGrid:
    """Converts scans to images. The weights of rows are computed again only when the azimuths change."""

    def __init__(self, config: PolarGridConfig) -> None:
        self.config = config
        self._azimuth_key = b''
        depths_m = (np.arange(config.range_bins) + 0.5) * config.resolution_m
        self._too_near = depths_m < config.min_range_m

    def __call__(self, scan: PolarScan) -> NDArray[np.uint8]:
        """(A, R) uint8 mean power of each cell; 0 nearer than `min_range_m`, beyond the last bin and in gaps."""
        azimuth_key = scan.azimuths_rad.tobytes()
        if azimuth_key != self._azimuth_key:
            self._weights = sector_weights(scan.azimuths_rad, self.config.azimuths)
            self._azimuth_key = azimuth_key
        image = np.rint(self._weights @ self._along_range(scan))
        image[:, self._too_near] = 0
        return np.asarray(image, np.uint8)

    def _along_range(self, scan: PolarScan) -> NDArray[np.float32]:
        """(rows, R) float32 mean power of each row within each column of the image.

        The range of the image is rounded to whole bins at both ends.
        """
        rows, bins = scan.power.shape
        reach_m = self.config.range_bins * self.config.resolution_m
        first, last = (round((end_m - scan.range_offset_m) / scan.range_resolution_m) for end_m in (0.0, reach_m))
        last = max(last, first + 1)
        seen = slice(min(max(first, 0), bins), min(max(last, 0), bins))
        power = scan.power[:, seen]
        if power.shape[1] < last - first:
            power = np.zeros((rows, last - first), np.uint8)
            power[:, seen.start - first : seen.stop - first] = scan.power[:, seen]
        return _area_means(power, self.config.range_bins).astype(np.float32)


def _area_means(power: NDArray[np.uint8], columns: int) -> NDArray[np.uint8]:
    """(rows, columns) uint8 of (rows, bins): the mean of each column's share of every row."""
    rows, bins = power.shape
    if bins <= columns:
        return np.asarray(cv2.resize(power, (columns, rows), interpolation=cv2.INTER_AREA), np.uint8)
    # On its side: OpenCV adds up rows several pixels at once, and columns one by one. The sums are the same.
    turned = cv2.resize(cv2.transpose(power), (rows, columns), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(turned.T, np.uint8)


def sector_weights(azimuths_rad: NDArray[np.float64], sectors: int) -> NDArray[np.float32]:
    """(sectors, rows) float32 share of each scan row in each sector; rows of zeros where the scan has a gap."""
    rows = len(azimuths_rad)
    turns = np.mod(azimuths_rad / (2.0 * np.pi), 1.0)
    order = np.argsort(turns, kind='stable')
    at = turns[order]
    before = np.diff(at, prepend=at[-1] - 1.0)
    after = np.roll(before, -1)
    # Without the widest step, which may be a gap: with few rows it would dominate the median.
    widest = _WIDEST_STEPS * float(np.median(np.sort(before)[: max(1, rows - 1)])) / 2.0
    starts, ends = at - np.minimum(before / 2.0, widest), at + np.minimum(after / 2.0, widest)
    edges = np.arange(sectors + 1) / sectors
    weights = np.zeros((sectors, rows))
    for turn in (-1.0, 0.0, 1.0):
        overlap = np.minimum(edges[1:, None], ends + turn) - np.maximum(edges[:-1, None], starts + turn)
        weights[:, order] += np.maximum(overlap, 0.0)
    # A sector of which a quarter or less is measured counts as a gap.
    seen = weights.sum(axis=1, keepdims=True)
    scale = np.where(seen > 0.25 / sectors, 1.0 / np.maximum(seen, 1e-12), 0.0)
    return (weights * scale).astype(np.float32)
