"""Bring an encoder's uncertainties to the scale that static thresholds expect: U = 1 on average over a run."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.types import PolarScan


def run_uncertainties(encoder: Encoder, scans: Iterable[PolarScan]) -> NDArray[np.float64]:
    """(N,) U of each scan of a run; scans that the encoder refuses are left out."""
    values = []
    for scan in scans:
        try:
            values.append(encoder.encode(scan).uncertainty)
        except RefusedInput:
            continue
    return np.array(values, np.float64)


def variance_factor(uncertainties: ArrayLike) -> float:
    """What the variance must be multiplied with so that the mean of these U is 1; DataError where there is none."""
    values = np.asarray(uncertainties, np.float64)
    values = values[np.isfinite(values)]
    if not values.size or not values.mean() > 0.0:
        raise DataError('calibration run: expected at least one scan with a finite, positive uncertainty, got none')
    return float(1.0 / values.mean())


def calibrate_variance_scale(encoder: Encoder, scans: Iterable[PolarScan]) -> float:
    """The factor that makes the mean U of the encoder 1 over `scans`.

    It multiplies the encoder's present variance scale, so that it *is* the scale for an encoder made with scale 1.
    """
    return variance_factor(run_uncertainties(encoder, scans))


def largest_deviation(uncertainties: ArrayLike) -> float:
    """max |U − 1| over calibrated uncertainties, a Δ (Sec. III-C) whose thresholds span the whole run; 0 for none."""
    values = np.asarray(uncertainties, np.float64)
    return float(np.max(np.abs(values[np.isfinite(values)] - 1.0), initial=0.0))
