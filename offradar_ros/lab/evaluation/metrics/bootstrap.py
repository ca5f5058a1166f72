"""Bootstrap intervals of a figure over the pairs of drives that were measured."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

LEVEL = 0.95
"""Share of the draws that an interval holds."""


def bootstrap_interval(
    groups: ArrayLike,
    statistic: Callable[[NDArray[np.float64]], float],
    *,
    resamples: int,
    seed: int,
) -> tuple[float, float]:
    """Percentile interval of a statistic when whole groups (pairs of drives) are drawn with replacement.

    Scans of one pair are not independent: single scans drawn would give too narrow an interval.

    Args:
        groups: (N,) int ≥ 0, the group of each row.
        statistic: takes (N,) float64 weights of the rows, how often each row's group was drawn.
        resamples: number of draws; a draw whose statistic is NaN is left out.
        seed: of the draws.

    Returns:
        (low, high); NaN if no draw gives a finite number, or for less than two groups.
    """
    labels, inverse = np.unique(np.asarray(groups), return_inverse=True)
    if len(labels) < 2:
        return math.nan, math.nan
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(len(labels), np.full(len(labels), 1.0 / len(labels)), resamples).astype(np.float64)
    found = np.array([statistic(times[inverse.reshape(-1)]) for times in drawn])
    found = found[np.isfinite(found)]
    if not len(found):
        return math.nan, math.nan
    low, high = np.quantile(found, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return float(low), float(high)
