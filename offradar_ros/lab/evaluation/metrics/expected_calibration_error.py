"""Expected calibration error of a probability (Guo et al., ICML 2017)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def expected_calibration_error(p_right: ArrayLike, right: ArrayLike, bins: int = 15) -> float:
    """Σ_b n_b/n |mean p − share right| over equal intervals of p.

    Args:
        p_right: (N,) probabilities, each in [0, 1].
        right: (N,) booleans.
        bins: number of intervals.

    Returns:
        0 to 1, lower is better; NaN without answers.
    """
    p, labels = np.asarray(p_right, np.float64), np.asarray(right, np.bool_)
    if not len(p):
        return math.nan
    rows = np.minimum((p * bins).astype(np.int64), bins - 1)
    return float(np.abs(np.bincount(rows, p - labels, bins)).sum()) / len(p)
