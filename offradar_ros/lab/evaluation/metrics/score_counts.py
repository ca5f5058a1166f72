"""Numbers of samples and of positives at each score, from which ranking metrics are computed."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclasses.dataclass(frozen=True, eq=False)
class ScoreCounts:
    """Weights at K different scores.

    Attributes:
        scores: (K,) ascending; the last may be infinite.
        samples: (K,) weight of the samples at each score, ≥ 0.
        positives: (K,) weight of the samples whose label is true.
    """

    scores: NDArray[np.float64]
    samples: NDArray[np.float64]
    positives: NDArray[np.float64]


class ScoreCounter:
    """Sorts (N,) scores once, to count them under many weightings."""

    def __init__(self, scores: ArrayLike, labels: ArrayLike) -> None:
        """ValueError for a score that is NaN."""
        values = np.asarray(scores, np.float64)
        if np.isnan(values).any():
            raise ValueError('expected scores without NaN')
        self._scores, codes = np.unique(values, return_inverse=True)
        self._codes = codes.reshape(-1)
        self._labels = np.asarray(labels, np.bool_).astype(np.float64)

    def counts(self, weights: ArrayLike | None = None) -> ScoreCounts:
        """The counts with (N,) weights ≥ 0; all are 1 by default."""
        weighted = np.ones(len(self._labels)) if weights is None else np.asarray(weights, np.float64)
        return ScoreCounts(self._scores, self._sums(weighted), self._sums(weighted * self._labels))

    def _sums(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.bincount(self._codes, weights, len(self._scores)), np.float64)
