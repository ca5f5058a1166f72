"""Recall@RR: recall of the queries that remain when the most uncertain share r of them is rejected.

Let C(m) be the number of the m most certain queries that are answered correctly. With m = (1 − r)·Q queries kept,
recall at rejection is C(m) / m. C is linear between whole numbers, and between queries of equal uncertainty, where it
is the mean over all orders. At r = 1 no query remains, and recall is NaN.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter, ScoreCounts


@dataclasses.dataclass(frozen=True, eq=False)
class RejectionCurve:
    """C as a polyline: `kept` (K,) ascends from 0 to the total weight, `correct` (K,) is the correct part of it."""

    kept: NDArray[np.float64]
    correct: NDArray[np.float64]

    def recall_at(self, rejected: float) -> float:
        """Recall when a share 0 ≤ `rejected` ≤ 1 is rejected; NaN if no query remains."""
        if not 0.0 <= rejected <= 1.0:
            raise ValueError(f'expected a share of 0 to 1, got {rejected}')
        total = float(self.kept[-1])
        kept = (1.0 - rejected) * total
        return float(np.interp(kept, self.kept, self.correct)) / kept if kept > 0.0 else math.nan

    def mean_recall(self, up_to: float) -> float:
        """Mean recall over rejected shares from 0 to `up_to` (at most 1): the area under the curve, over `up_to`.

        It is exact: on each piece C(m) = a + b·m, and ∫ C(m)/m dm = a·ln m + b·m. The first piece has a = 0, so that
        the area up to 1 is finite. NaN without queries.
        """
        if not 0.0 < up_to <= 1.0:
            raise ValueError(f'expected a share above 0 and at most 1, got {up_to}')
        total = float(self.kept[-1])
        if not total > 0.0:
            return math.nan
        lowest = (1.0 - up_to) * total
        inner = self.kept > lowest
        kept = np.concatenate([[lowest], self.kept[inner]])
        correct = np.concatenate([[np.interp(lowest, self.kept, self.correct)], self.correct[inner]])
        slope = np.diff(correct) / np.diff(kept)
        offset = correct[1:] - slope * kept[1:]
        with np.errstate(divide='ignore', invalid='ignore'):
            bent = np.where(kept[:-1] > 0.0, offset * np.log(kept[1:] / kept[:-1]), 0.0)
        return float(np.sum(bent + slope * np.diff(kept))) / (up_to * total)


def rejection_curve(uncertainties: ArrayLike, correct: ArrayLike) -> RejectionCurve:
    """The curve of (Q,) uncertainties (infinite ones are rejected first) and (Q,) booleans."""
    return rejection_curve_of(ScoreCounter(uncertainties, correct).counts())


def rejection_curve_of(counts: ScoreCounts) -> RejectionCurve:
    """`rejection_curve` of counted uncertainties, whose label is whether the answer is correct."""
    weighted = counts.samples > 0.0
    kept, correct = (np.concatenate([[0.0], np.cumsum(part[weighted])]) for part in (counts.samples, counts.positives))
    return RejectionCurve(kept, correct)
