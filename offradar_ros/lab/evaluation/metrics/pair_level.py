"""Precision and recall of pairs: is a query and a place of this embedding distance or less the same place?

Every query with every place of the map is a pair: a right one within the tolerance, a wrong one beyond the distance of
negatives, and neither in between (Sec. IV-C of the paper: 25 m and 50 m).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.evaluation.metrics.precision_recall import PrecisionRecallCurve

RECALLS = np.linspace(0.0, 1.0, 101)
"""At which precision is told."""


@dataclasses.dataclass(frozen=True, eq=False)
class PairLevel:
    """What is kept of millions of pairs: both are NaN without a right pair.

    Attributes:
        average_precision: over thresholds on the distance.
        precisions: (101,) the highest precision at recall 0, 0.01, …, 1 or more.
    """

    average_precision: float
    precisions: NDArray[np.float64]


class PairTally:
    """Gathers distances of pairs, block by block, in single precision."""

    def __init__(self) -> None:
        self._right: list[NDArray[np.float32]] = []
        self._wrong: list[NDArray[np.float32]] = []

    def add(self, distances: NDArray[np.float64], right: NDArray[np.bool_], wrong: NDArray[np.bool_]) -> None:
        """Distances (of any monotonic kind) and which of them are of right and of wrong pairs, all of one shape.

        Infinite ones are never accepted: a right pair among them is missed at every threshold.
        """
        self._right.append(distances[right].astype(np.float32))
        self._wrong.append(distances[wrong].astype(np.float32))

    def level(self) -> PairLevel:
        """Of all that was added."""
        curve = pair_curve(*(np.concatenate([np.empty(0, np.float32), *part]) for part in (self._right, self._wrong)))
        return PairLevel(curve.average_precision, precisions_at(curve, RECALLS))


def pair_curve(right: ArrayLike, wrong: ArrayLike) -> PrecisionRecallCurve:
    """The curve of (R,) distances of right pairs and (W,) of wrong ones: a point at each finite one of a right pair.

    Between two of those recall stands still and precision falls, which no area and no F_β gains from.
    """
    good, bad = np.sort(np.asarray(right)), np.sort(np.asarray(wrong))
    relevant = float(len(good))
    good = good[np.isfinite(good)]
    last = np.flatnonzero(np.append(good[1:] != good[:-1], True)) if len(good) else np.empty(0, np.intp)
    hits = (last + 1).astype(np.float64)
    accepted = hits + np.searchsorted(bad, good[last], side='right')
    return PrecisionRecallCurve(good[last].astype(np.float64), accepted, hits, relevant)


def precisions_at(curve: PrecisionRecallCurve, recalls: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K,) the highest precision at each of (K,) recalls or more: 0 where none is so high, NaN without a curve."""
    if not curve.relevant > 0.0:
        return np.full(len(recalls), np.nan)
    best_from = np.append(np.maximum.accumulate(curve.precision[::-1])[::-1], 0.0)
    # Recalls are quotients of whole numbers: a rounding error must not miss the last point.
    return best_from[np.searchsorted(curve.recall + 1e-12, recalls, side='left')]
