"""How much of what there is, and how much of it is so, at each score: all that rank statistics ask for."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclasses.dataclass(frozen=True, eq=False)
class Tally:
    """Attributes, of K different scores.

    scores: (K,) ascending; the last may be infinite.
    every: (K,) weight at each score, ≥ 0.
    so: (K,) the part of it whose label is true.
    """

    scores: NDArray[np.float64]
    every: NDArray[np.float64]
    so: NDArray[np.float64]


class Tallier:
    """Sorts (N,) scores once, to tally them under many weightings."""

    def __init__(self, scores: ArrayLike, labels: ArrayLike) -> None:
        """ValueError for a score that is NaN."""
        values = np.asarray(scores, np.float64)
        if np.isnan(values).any():
            raise ValueError('NaN has no place among scores')
        self._scores, codes = np.unique(values, return_inverse=True)
        self._codes = codes.reshape(-1)
        self._labels = np.asarray(labels, np.bool_).astype(np.float64)

    def __call__(self, weights: ArrayLike | None = None) -> Tally:
        """With (N,) weights ≥ 0; all alike by default."""
        mass = np.ones(len(self._labels)) if weights is None else np.asarray(weights, np.float64)
        return Tally(self._scores, self._sums(mass), self._sums(mass * self._labels))

    def _sums(self, mass: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.bincount(self._codes, mass, len(self._scores)), np.float64)
