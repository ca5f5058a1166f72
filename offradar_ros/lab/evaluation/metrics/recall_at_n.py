"""Recall@N: share of queries with a positive among the N nearest places."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def recall_at_n(ranks: ArrayLike, n: int, weights: ArrayLike | None = None) -> float:
    """Share of queries whose first positive is among the `n` nearest.

    Args:
        ranks: (Q,) int, 0 where the nearest place is a positive, 1 where the second is the first positive, and so on;
            any number ≥ n if none of the n nearest is one. Pass only the queries that have a positive.
        n: at least 1.
        weights: (Q,) weights ≥ 0 of the queries; all are 1 by default.

    Returns:
        0 to 1; NaN without queries. ValueError for an `n` below 1.
    """
    if n < 1:
        raise ValueError(f'expected N of at least 1, got {n}')
    found = np.asarray(ranks) < n
    weighted = np.ones(len(found)) if weights is None else np.asarray(weights, np.float64)
    total = float(weighted.sum())
    return float(weighted @ found) / total if total > 0.0 else math.nan
