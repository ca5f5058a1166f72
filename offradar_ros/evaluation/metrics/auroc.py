"""How well a score tells two classes apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def auroc(scores: ArrayLike, positive: ArrayLike, weights: ArrayLike | None = None) -> float:
    """P(score of a positive > score of a negative) + ½ P(they are equal), each drawn at random.

    Args:
        scores: (N,) numbers, infinite ones allowed.
        positive: (N,) booleans.
        weights: (N,) weights ≥ 0 of the draws; all alike by default.

    Returns:
        0 to 1; NaN where one of the classes has no weight.
    """
    values, labels = np.asarray(scores, np.float64), np.asarray(positive, np.bool_)
    mass = np.ones(len(values)) if weights is None else np.asarray(weights, np.float64)
    if np.isnan(values).any():
        raise ValueError('NaN has no place among scores')
    _, inverse = np.unique(values, return_inverse=True)
    inverse = inverse.reshape(-1)
    hits = np.bincount(inverse, mass * labels)
    misses = np.bincount(inverse, mass * ~labels)
    total = float(hits.sum()) * float(misses.sum())
    if not total > 0.0:
        return math.nan
    below = np.cumsum(misses) - misses
    return float(hits @ (below + 0.5 * misses)) / total
