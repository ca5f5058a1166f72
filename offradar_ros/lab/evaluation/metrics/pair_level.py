"""Precision and recall of pairs of a query and a place, accepted by their distance in embedding space.

Every query with every place of the map is a pair: positive within the tolerance, negative beyond the distance of
negatives, and left out between the two (Sec. IV-C of the paper: 25 m and 50 m).
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
    """Figures of all pairs; both are NaN without a positive pair.

    Attributes:
        average_precision: over thresholds on the distance.
        precisions: (101,) the highest precision at recall 0, 0.01, …, 1 or more.
    """

    average_precision: float
    precisions: NDArray[np.float64]


class PairDistances:
    """Collects distances of pairs, block by block, in single precision."""

    def __init__(self) -> None:
        self._positive: list[NDArray[np.float32]] = []
        self._negative: list[NDArray[np.float32]] = []

    def add(self, distances: NDArray[np.float64], positive: NDArray[np.bool_], negative: NDArray[np.bool_]) -> None:
        """Add distances (or squared ones), and which of them are of positive and of negative pairs; all of one shape.

        An infinite distance is never accepted: a positive pair with one is missed at every threshold.
        """
        self._positive.append(distances[positive].astype(np.float32))
        self._negative.append(distances[negative].astype(np.float32))

    def level(self) -> PairLevel:
        """The figures of all pairs that were added."""
        none = np.empty(0, np.float32)
        curve = pair_curve(*(np.concatenate([none, *part]) for part in (self._positive, self._negative)))
        return PairLevel(curve.average_precision, precisions_at(curve, RECALLS))


def pair_curve(positive: ArrayLike, negative: ArrayLike) -> PrecisionRecallCurve:
    """The curve of (P,) distances of positive pairs and (N,) of negative ones: a point at each finite positive one.

    Between two of those, recall is constant and precision falls, so that neither the area nor the highest F_β changes.
    """
    positives, negatives = np.sort(np.asarray(positive)), np.sort(np.asarray(negative))
    relevant = float(len(positives))
    positives = positives[np.isfinite(positives)]
    last = np.flatnonzero(np.append(positives[1:] != positives[:-1], True)) if len(positives) else np.empty(0, np.intp)
    true_positives = (last + 1).astype(np.float64)
    accepted = true_positives + np.searchsorted(negatives, positives[last], side='right')
    return PrecisionRecallCurve(positives[last].astype(np.float64), accepted, true_positives, relevant)


def precisions_at(curve: PrecisionRecallCurve, recalls: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,) the highest precision at a recall of at least each of the (K,) `recalls`.

    It is 0 above the highest recall of the curve, and NaN if nothing is relevant.
    """
    if not curve.relevant > 0.0:
        return np.full(len(recalls), np.nan)
    best_from = np.append(np.maximum.accumulate(curve.precision[::-1])[::-1], 0.0)
    # A rounding error of the quotients must not miss the last point.
    return best_from[np.searchsorted(curve.recall + 1e-12, recalls, side='left')]
