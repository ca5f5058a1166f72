"""Scale of an encoder's variance, so that U = 1 on average over a drive, and Δ for these U."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from offradar_ros.errors import DataError


def variance_factor(uncertainties: ArrayLike) -> float:
    """Factor on the variance that makes the mean of these (N,) U equal to 1, the prior's (Sec. III-C of the paper).

    Values that are not finite do not count. DataError if none is left, or if their mean is not positive.
    """
    values = np.asarray(uncertainties, np.float64)
    values = values[np.isfinite(values)]
    if not values.size or not values.mean() > 0.0:
        raise DataError('calibration run: expected at least one scan with a finite, positive uncertainty, got none')
    return float(1.0 / values.mean())


def largest_deviation(uncertainties: ArrayLike) -> float:
    """max |U − 1| over (N,) calibrated U, a Δ (Sec. III-C) whose thresholds span the whole drive; 0 for no value."""
    values = np.asarray(uncertainties, np.float64)
    return float(np.max(np.abs(values[np.isfinite(values)] - 1.0), initial=0.0))


def spanning_delta(uncertainties: ArrayLike) -> float:
    """`largest_deviation`, rounded up to the next millionth.

    Single precision must not put the scan with the largest U above the highest threshold.
    """
    return (math.floor(largest_deviation(uncertainties) * 1e6) + 1) / 1e6
