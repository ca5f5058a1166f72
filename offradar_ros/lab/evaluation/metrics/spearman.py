"""Spearman's rank correlation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike


def spearman(first: ArrayLike, second: ArrayLike) -> float:
    """`scipy.stats.spearmanr` of two (N,) arrays, equal values at the mean of their ranks; infinite ones are allowed.

    NaN, without a warning, where one of them is constant or empty; ValueError for NaN among them, or two lengths.
    """
    # Takes a second to load, which a command that needs none of it would wait for.
    from scipy.stats import spearmanr  # noqa: PLC0415

    a, b = (np.asarray(values, np.float64) for values in (first, second))
    if a.shape != b.shape or a.ndim != 1:
        raise ValueError(f'expected two arrays of one length, got shapes {a.shape} and {b.shape}')
    if np.isnan(a).any() or np.isnan(b).any():
        raise ValueError('NaN has no rank')
    if not len(a) or (a == a[0]).all() or (b == b[0]).all():
        return math.nan
    return float(spearmanr(a, b).statistic)
