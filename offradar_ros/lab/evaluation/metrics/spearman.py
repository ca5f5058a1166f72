"""Spearman's rank correlation."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from offradar_ros.lab.evaluation.metrics.ranks import mean_ranks


def spearman(first: ArrayLike, second: ArrayLike) -> float:
    """Pearson's correlation of the mean ranks of two (N,) arrays; NaN where one of them is constant or empty."""
    ranks = [mean_ranks(values) for values in (first, second)]
    if len(ranks[0]) != len(ranks[1]):
        raise ValueError(f'expected two arrays of one length, got {len(ranks[0])} and {len(ranks[1])}')
    a, b = (r - (len(r) + 1) / 2.0 for r in ranks)
    scale = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / scale if scale > 0.0 else math.nan
