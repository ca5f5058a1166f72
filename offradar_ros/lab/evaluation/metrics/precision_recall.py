"""Precision and recall of answers that are accepted when their score is low enough, and their summary figures."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter, ScoreCounts


@dataclasses.dataclass(frozen=True, eq=False)
class PrecisionRecallCurve:
    """One point for each distinct finite score, by ascending threshold.

    Attributes:
        thresholds: (K,) an answer is accepted if its score is at most this.
        accepted: (K,) weight of the accepted answers, true and false positives.
        true_positives: (K,) weight of the accepted answers that are correct.
        relevant: weight of what should be accepted: true positives and false negatives.
    """

    thresholds: NDArray[np.float64]
    accepted: NDArray[np.float64]
    true_positives: NDArray[np.float64]
    relevant: float

    @property
    def precision(self) -> NDArray[np.float64]:
        """(K,) share of the accepted answers that are correct."""
        shares: NDArray[np.float64] = self.true_positives / self.accepted
        return shares

    @property
    def recall(self) -> NDArray[np.float64]:
        """(K,) share of what is relevant that is accepted and correct; NaN if nothing is relevant."""
        if not self.relevant > 0.0:
            return np.full(len(self.true_positives), math.nan)
        shares: NDArray[np.float64] = self.true_positives / self.relevant
        return shares

    @property
    def average_precision(self) -> float:
        """Σ (R_k − R_{k−1}) P_k, without interpolation; NaN if nothing is relevant."""
        if not self.relevant > 0.0:
            return math.nan
        return float(np.diff(self.recall, prepend=0.0) @ self.precision)

    def f_beta(self, beta: float) -> NDArray[np.float64]:
        """(K,) F_β = (1 + β²) P R / (β² P + R), 0 if both are 0; β weights recall against precision."""
        if not beta > 0.0:
            raise ValueError(f'expected β above 0, got {beta}')
        # (1 + β²) TP / (β² (TP + FN) + TP + FP): the same, and never 0 / 0.
        found: NDArray[np.float64] = (1.0 + beta**2) * self.true_positives / (beta**2 * self.relevant + self.accepted)
        return found

    def max_f_beta(self, beta: float) -> tuple[float, float]:
        """(highest F_β over all thresholds, lowest threshold that gives it); NaN if nothing is relevant or accepted."""
        if not self.relevant > 0.0 or not len(self.thresholds):
            return math.nan, math.nan
        found = self.f_beta(beta)
        best = int(found.argmax())
        return float(found[best]), float(self.thresholds[best])

    def f_beta_at(self, threshold: float, beta: float) -> float:
        """F_β at one threshold: 0 if it accepts nothing, NaN if nothing is relevant."""
        if not self.relevant > 0.0:
            return math.nan
        last = int(np.searchsorted(self.thresholds, threshold, side='right')) - 1
        return float(self.f_beta(beta)[last]) if last >= 0 else 0.0


def precision_recall(scores: ArrayLike, correct: ArrayLike, relevant: float | None = None) -> PrecisionRecallCurve:
    """The curve of N answers, of which those with low scores are accepted first.

    Args:
        scores: (N,) distances in embedding space or uncertainties; an infinite one is never accepted.
        correct: (N,) booleans.
        relevant: number of answers that should be accepted: that of all queries with a positive, found or not. By
            default that of the correct answers, as in scikit-learn and in STUN's evaluation, where recall ends at 1.

    ValueError for a score that is NaN.
    """
    counts = ScoreCounter(scores, correct).counts()
    return precision_recall_of(counts, float(counts.positives.sum()) if relevant is None else relevant)


def precision_recall_of(counts: ScoreCounts, relevant: float) -> PrecisionRecallCurve:
    """`precision_recall` of counted scores, whose label is whether the answer is correct."""
    possible = np.isfinite(counts.scores) & (counts.samples > 0.0)
    accepted, true_positives = (np.cumsum(part[possible]) for part in (counts.samples, counts.positives))
    return PrecisionRecallCurve(counts.scores[possible], accepted, true_positives, relevant)
