"""How the radar moved from one scan to the next: its turn and its step, from the scans alone.

Convention: the turn is counter-clockwise seen from above. Azimuths grow clockwise, so what stands still gets a larger
azimuth when the radar turns to the left. The turn is where the azimuths of both scans correlate best, the step where
their Cartesian images do, once one is turned back.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan

RANGE_M = 96.0
_CELL_M = 1.5
_CELLS = round(RANGE_M / _CELL_M)
_ROWS = 400
LONGEST_STEP_NS = 2 * 10**9
"""Scans further apart than this are not compared."""


class Motion(NamedTuple):
    """Motion between two scans.

    Attributes:
        stamp_ns: the middle of their stamps.
        turn_rate: rad/s, counter-clockwise.
        speed_mps: m/s, never negative; rough, to a third.
    """

    stamp_ns: int
    turn_rate: float
    speed_mps: float


class ScanMotion:
    """Motion between each scan and the one before it."""

    def __init__(self) -> None:
        self._before: tuple[int, NDArray[np.float32]] | None = None
        self._window = cv2.createHanningWindow((2 * _CELLS, 2 * _CELLS), cv2.CV_32F)

    def add(self, scan: PolarScan) -> Motion | None:
        """Motion since the scan before; None for the first one, and after a gap or a step back."""
        before, now = self._before, _reduced(scan)
        self._before = (scan.stamp_ns, now)
        if before is None or not 0 < scan.stamp_ns - before[0] <= LONGEST_STEP_NS:
            return None
        step_ns = scan.stamp_ns - before[0]
        rows = _turn_rows(before[1], now)
        turned_back = np.roll(now, -round(rows), axis=0)
        (x, y), _ = cv2.phaseCorrelate(_cartesian(before[1]), _cartesian(turned_back), self._window)
        seconds = step_ns / 1e9
        return Motion(
            before[0] + step_ns // 2,
            rows * (2 * np.pi / _ROWS) / seconds,
            float(np.hypot(x, y)) * _CELL_M / seconds,
        )


def _reduced(scan: PolarScan) -> NDArray[np.float32]:
    """(400, 64) power up to `RANGE_M`, from azimuth 0, each range's mean taken away."""
    bins = max(1, min(scan.power.shape[1], round(RANGE_M / scan.range_resolution_m)))
    # Rows need not be in the order of their azimuths: with radar.azimuth_direction counterclockwise they go back.
    near = scan.power[np.argsort(scan.azimuths_rad, kind='stable'), :bins]
    cells = max(1, round(_CELLS * bins * scan.range_resolution_m / RANGE_M))
    reduced = cv2.resize(near, (min(cells, _CELLS), _ROWS), interpolation=cv2.INTER_AREA).astype(np.float32)
    padded = np.zeros((_ROWS, _CELLS), np.float32)
    padded[:, : reduced.shape[1]] = reduced - reduced.mean(axis=0)
    return padded


def _turn_rows(before: NDArray[np.float32], now: NDArray[np.float32]) -> float:
    """By how many rows `now` is `before` rolled, −200 to 200, to a fraction of a row."""
    spectrum = np.conj(np.fft.rfft(before, axis=0)) * np.fft.rfft(now, axis=0)
    correlation = np.fft.irfft(spectrum.sum(axis=1), _ROWS)
    peak = int(np.argmax(correlation))
    left, middle, right = correlation[[peak - 1, peak, (peak + 1) % _ROWS]]
    curvature = left - 2.0 * middle + right
    fraction = 0.5 * (left - right) / curvature if curvature < 0.0 else 0.0
    return float((peak + fraction + _ROWS / 2) % _ROWS - _ROWS / 2)


def _cartesian(polar: NDArray[np.float32]) -> NDArray[np.float32]:
    """(128, 128) image with the radar in the middle."""
    size = 2 * _CELLS
    flags = cv2.WARP_INVERSE_MAP | cv2.WARP_FILL_OUTLIERS | cv2.INTER_LINEAR
    return np.asarray(cv2.warpPolar(polar, (size, size), (_CELLS, _CELLS), _CELLS, flags), np.float32)
