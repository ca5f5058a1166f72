"""Area under the ROC curve: how well a score separates two classes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter, ScoreCounts


def auroc(scores: ArrayLike, positive: ArrayLike) -> float:
    """P(score of a positive > score of a negative) + ½ P(they are equal), each drawn at random.

    Args:
        scores: (N,) numbers, infinite ones allowed.
        positive: (N,) booleans.

    Returns:
        0 to 1; NaN if one of the classes is empty. ValueError for a score that is NaN.
    """
    return auroc_of(ScoreCounter(scores, positive).counts())


def auroc_of(counts: ScoreCounts) -> float:
    """`auroc` of counted scores, each drawn by its weight."""
    positives, negatives = counts.positives, counts.samples - counts.positives
    total = float(positives.sum()) * float(negatives.sum())
    if not total > 0.0:
        return math.nan
    below = np.cumsum(negatives) - negatives
    return float(positives @ (below + 0.5 * negatives)) / total
