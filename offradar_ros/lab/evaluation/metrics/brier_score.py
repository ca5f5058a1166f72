"""Brier score: the mean squared error of a probability (Brier, Monthly Weather Review 78, 1950)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def brier_score(p_right: ArrayLike, right: ArrayLike) -> float:
    """Mean of (1 − p)² of (N,) right answers and p² of wrong ones: 0 to 1, lower is better; NaN without answers."""
    errors = np.asarray(p_right, np.float64) - np.asarray(right, np.bool_)
    return float(np.mean(errors**2)) if len(errors) else math.nan
