"""How well a score tells two classes apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from offradar_ros.lab.evaluation.metrics.tally import Tallier, Tally


def auroc(scores: ArrayLike, positive: ArrayLike, weights: ArrayLike | None = None) -> float:
    """P(score of a positive > score of a negative) + ½ P(they are equal), each drawn at random.

    Args:
        scores: (N,) numbers, infinite ones allowed.
        positive: (N,) booleans.
        weights: (N,) weights ≥ 0 of the draws; all alike by default.

    Returns:
        0 to 1; NaN where one of the classes has no weight.
    """
    return auroc_of(Tallier(scores, positive)(weights))


def auroc_of(tally: Tally) -> float:
    """The same of what is already tallied."""
    hits, misses = tally.so, tally.every - tally.so
    total = float(hits.sum()) * float(misses.sum())
    if not total > 0.0:
        return math.nan
    below = np.cumsum(misses) - misses
    return float(hits @ (below + 0.5 * misses)) / total
