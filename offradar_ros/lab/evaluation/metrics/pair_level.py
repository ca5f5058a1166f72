"""Precision and recall of pairs: is a query and a place of this embedding distance or less the same place?

Every query with every place of the map is a pair: a positive one within the tolerance, a negative one beyond the
distance of negatives, and neither in between (Sec. IV-C of the paper: 25 m and 50 m).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.evaluation.metrics.precision_recall import PrecisionRecallCurve

RECALLS = np.linspace(0.0, 1.0, 101)
"""Recalls at which precision is reported."""


@dataclasses.dataclass(frozen=True, eq=False)
class PairLevel:
    """What is kept of millions of pairs: both are NaN without a positive pair.

    Attributes:
        average_precision: over thresholds on the distance.
        precisions: (101,) the highest precision at recall 0, 0.01, …, 1 or more.
    """

    average_precision: float
    precisions: NDArray[np.float64]


class PairDistances:
    """Gathers distances of pairs, block by block, in single precision."""

    def __init__(self) -> None:
        self._positive: list[NDArray[np.float32]] = []
        self._negative: list[NDArray[np.float32]] = []

    def add(self, distances: NDArray[np.float64], positive: NDArray[np.bool_], negative: NDArray[np.bool_]) -> None:
        """Distances (of any monotonic kind), and which of them are of positive and of negative pairs, of one shape.

        Infinite ones are never accepted: a positive pair among them is missed at every threshold.
        """
        self._positive.append(distances[positive].astype(np.float32))
        self._negative.append(distances[negative].astype(np.float32))

    def level(self) -> PairLevel:
        """Of all that was added."""
        none = np.empty(0, np.float32)
        curve = pair_curve(*(np.concatenate([none, *part]) for part in (self._positive, self._negative)))
        return PairLevel(curve.average_precision, precisions_at(curve, RECALLS))


def pair_curve(positive: ArrayLike, negative: ArrayLike) -> PrecisionRecallCurve:
    """The curve of (P,) distances of positive pairs and (N,) of negative ones: a point at each finite positive one.

    Between two of those recall stands still and precision falls, which no area and no F_β gains from.
    """
    positives, negatives = np.sort(np.asarray(positive)), np.sort(np.asarray(negative))
    relevant = float(len(positives))
    positives = positives[np.isfinite(positives)]
    last = np.flatnonzero(np.append(positives[1:] != positives[:-1], True)) if len(positives) else np.empty(0, np.intp)
    true_positives = (last + 1).astype(np.float64)
    accepted = true_positives + np.searchsorted(negatives, positives[last], side='right')
    return PrecisionRecallCurve(positives[last].astype(np.float64), accepted, true_positives, relevant)


def precisions_at(curve: PrecisionRecallCurve, recalls: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,) the highest precision at each of (K,) recalls or more: 0 where none is so high, NaN without a curve."""
    if not curve.relevant > 0.0:
        return np.full(len(recalls), np.nan)
    best_from = np.append(np.maximum.accumulate(curve.precision[::-1])[::-1], 0.0)
    # Recalls are quotients of whole numbers: a rounding error must not miss the last point.
    return best_from[np.searchsorted(curve.recall + 1e-12, recalls, side='left')]
