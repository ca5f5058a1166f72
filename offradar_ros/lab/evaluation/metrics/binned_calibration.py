"""Expected calibration error over bins of U, as STUN (Cai et al., 2022) measures it.

U is not a probability. Its range is divided into ten bins, b = 0 with the lowest U; the recall that is expected in bin
b is 1 − b / 10: 1 in the first, 0.1 in the last.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

BINS = 10
FEWEST_IN_LAST = 0.001
"""The upper edge is lowered until the last bin holds more than this share of the queries."""


@dataclasses.dataclass(frozen=True, eq=False)
class BinnedCalibration:
    """Recall in B bins of ascending U.

    Attributes:
        edges: (B + 1,) of U; the last bin holds everything above its lower edge.
        shares: (B,) of the queries.
        recalls: (B,) Recall@1, NaN in an empty bin.
        expected: (B,) recall that is expected.
    """

    edges: NDArray[np.float64]
    shares: NDArray[np.float64]
    recalls: NDArray[np.float64]
    expected: NDArray[np.float64]

    @property
    def error(self) -> float:
        """Σ share · |recall − expected|; NaN without queries."""
        if not len(self.shares):
            return math.nan
        return float(self.shares @ np.nan_to_num(np.abs(self.recalls - self.expected)))


def binned_calibration(uncertainties: ArrayLike, correct: ArrayLike) -> BinnedCalibration:
    """Bins of Q queries: (Q,) U, infinite values in the last bin, and (Q,) booleans.

    There are no bins without a finite U. ValueError for NaN.
    """
    values, labels = np.asarray(uncertainties, np.float64), np.asarray(correct, np.bool_)
    if np.isnan(values).any():
        raise ValueError('expected uncertainties without NaN')
    finite = np.sort(values[np.isfinite(values)])
    if not len(finite):
        return BinnedCalibration(*(np.empty(0) for _ in range(4)))
    edges = np.linspace(finite[0], _upper_edge(finite, len(values)), BINS + 1)
    bins = np.clip(np.searchsorted(edges, values, side='right') - 1, 0, BINS - 1)
    count = np.bincount(bins, minlength=BINS).astype(np.float64)
    hits = np.bincount(bins, labels, BINS)
    recalls = np.divide(hits, count, out=np.full(BINS, math.nan), where=count > 0.0)
    return BinnedCalibration(edges, count / len(values), recalls, 1.0 - np.arange(BINS) / BINS)


def _upper_edge(ascending: NDArray[np.float64], queries: int) -> float:
    """The highest U for which the last bin holds more than `FEWEST_IN_LAST` of the queries."""
    lowest, above = float(ascending[0]), queries - len(ascending)
    for edge in ascending[::-1]:
        last = lowest + (float(edge) - lowest) * (BINS - 1) / BINS
        held = above + len(ascending) - int(np.searchsorted(ascending, last, side='left'))
        if held > FEWEST_IN_LAST * queries:
            return float(edge)
    return lowest
