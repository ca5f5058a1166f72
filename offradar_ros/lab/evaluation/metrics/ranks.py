"""Ranks in which equal values share the mean of theirs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def mean_ranks(values: ArrayLike) -> NDArray[np.float64]:
    """(N,) float64 ranks 1 to N of (N,) values, ascending; ValueError for NaN."""
    array = np.asarray(values, np.float64)
    if np.isnan(array).any():
        raise ValueError('NaN has no rank')
    _, inverse, counts = np.unique(array, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    ranks: NDArray[np.float64] = (last - (counts - 1) / 2.0)[inverse.reshape(-1)]
    return ranks
