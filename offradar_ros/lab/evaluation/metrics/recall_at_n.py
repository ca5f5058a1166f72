"""Recall@N: is one of the N nearest places a positive?"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def recall_at_n(ranks: ArrayLike, n: int, weights: ArrayLike | None = None) -> float:
    """Share of queries whose first positive is among the `n` nearest.

    Args:
        ranks: (Q,) int, 0 where the nearest place is a positive, 1 where the second is the first positive, and so on;
            any number ≥ n where none of the n nearest is. To count queries with a positive only, pass only those.
        n: at least 1.
        weights: (Q,) weights ≥ 0 of the queries; all are 1 by default.

    Returns:
        0 to 1; NaN where there is no query.
    """
    if n < 1:
        raise ValueError(f'expected N of at least 1, got {n}')
    found = np.asarray(ranks) < n
    weighted = np.ones(len(found)) if weights is None else np.asarray(weights, np.float64)
    total = float(weighted.sum())
    return float(weighted @ found) / total if total > 0.0 else math.nan
