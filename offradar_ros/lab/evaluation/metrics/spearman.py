"""Spearman's rank correlation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def spearman(first: ArrayLike, second: ArrayLike) -> float:
    """`scipy.stats.spearmanr` of two (N,) arrays; equal values have their mean rank, infinite values are allowed.

    NaN, without a warning, if one array is constant or empty; ValueError for NaN values or different lengths.
    """
    # It takes a second to load, also for commands that do not use it.
    from scipy.stats import spearmanr  # noqa: PLC0415

    a, b = (np.asarray(values, np.float64) for values in (first, second))
    if a.shape != b.shape or a.ndim != 1:
        raise ValueError(f'expected two arrays of one length, got shapes {a.shape} and {b.shape}')
    if np.isnan(a).any() or np.isnan(b).any():
        raise ValueError('expected values without NaN')
    if not len(a) or (a == a[0]).all() or (b == b[0]).all():
        return math.nan
    return float(spearmanr(a, b).statistic)
