"""Bring an encoder's uncertainties to the scale that static thresholds expect: U = 1 on average over a run."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from offradar_ros.errors import DataError


def variance_factor(uncertainties: ArrayLike) -> float:
    """What the variance must be multiplied with so that the mean of these U is 1; DataError where there is none."""
    values = np.asarray(uncertainties, np.float64)
    values = values[np.isfinite(values)]
    if not values.size or not values.mean() > 0.0:
        raise DataError('calibration run: expected at least one scan with a finite, positive uncertainty, got none')
    return float(1.0 / values.mean())


def largest_deviation(uncertainties: ArrayLike) -> float:
    """max |U − 1| over calibrated uncertainties, a Δ (Sec. III-C) whose thresholds span the whole run; 0 for none."""
    values = np.asarray(uncertainties, np.float64)
    return float(np.max(np.abs(values[np.isfinite(values)] - 1.0), initial=0.0))


def spanning_delta(uncertainties: ArrayLike) -> float:
    """`largest_deviation`, up to the next millionth: single precision must not push the scan that set it out."""
    return (math.floor(largest_deviation(uncertainties) * 1e6) + 1) / 1e6
