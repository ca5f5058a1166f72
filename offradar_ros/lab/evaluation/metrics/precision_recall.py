"""Precision and recall of answers that are accepted when their score is low enough, and figures from them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter, ScoreCounts


@dataclasses.dataclass(frozen=True, eq=False)
class PrecisionRecallCurve:
    """One point for each distinct score at which something is accepted, by ascending threshold.

    Attributes:
        thresholds: (K,) what is accepted scores this or less.
        accepted: (K,) weight of the accepted, true and false positives.
        true_positives: (K,) weight of the correct ones among them.
        relevant: weight of what should be accepted, true positives and false negatives.
    """

    thresholds: NDArray[np.float64]
    accepted: NDArray[np.float64]
    true_positives: NDArray[np.float64]
    relevant: float

    @property
    def precision(self) -> NDArray[np.float64]:
        """(K,) share of the accepted that is correct."""
        shares: NDArray[np.float64] = self.true_positives / self.accepted
        return shares

    @property
    def recall(self) -> NDArray[np.float64]:
        """(K,) share of the relevant that is accepted and correct; NaN where nothing is relevant."""
        if not self.relevant > 0.0:
            return np.full(len(self.true_positives), math.nan)
        shares: NDArray[np.float64] = self.true_positives / self.relevant
        return shares

    @property
    def average_precision(self) -> float:
        """Σ (R_k − R_{k−1}) P_k, without interpolation; NaN where nothing is relevant."""
        if not self.relevant > 0.0:
            return math.nan
        return float(np.diff(self.recall, prepend=0.0) @ self.precision)

    def f_beta(self, beta: float) -> NDArray[np.float64]:
        """(K,) F_β = (1 + β²) P R / (β² P + R), 0 where both are 0: recall matters β times as much as precision."""
        if not beta > 0.0:
            raise ValueError(f'expected β above 0, got {beta}')
        # (1 + β²) TP / (β² (TP + FN) + TP + FP): the same, and never 0 / 0.
        found: NDArray[np.float64] = (1.0 + beta**2) * self.true_positives / (beta**2 * self.relevant + self.accepted)
        return found

    def max_f_beta(self, beta: float) -> tuple[float, float]:
        """The highest F_β over all thresholds, and the lowest threshold that has it; NaN where nothing is relevant."""
        if not self.relevant > 0.0 or not len(self.thresholds):
            return math.nan, math.nan
        found = self.f_beta(beta)
        best = int(found.argmax())
        return float(found[best]), float(self.thresholds[best])

    def f_beta_at(self, threshold: float, beta: float) -> float:
        """F_β of one deployed threshold: 0 where it accepts nothing, NaN where nothing is relevant."""
        if not self.relevant > 0.0:
            return math.nan
        last = int(np.searchsorted(self.thresholds, threshold, side='right')) - 1
        return float(self.f_beta(beta)[last]) if last >= 0 else 0.0


def precision_recall(
    scores: ArrayLike, correct: ArrayLike, relevant: float | None = None, weights: ArrayLike | None = None
) -> PrecisionRecallCurve:
    """The curve of (N,) scores, of which low ones are accepted first, and (N,) whether what is accepted is correct.

    Args:
        scores: embedding distances or uncertainties; what is infinite is never accepted.
        correct: booleans.
        relevant: weight of what should be accepted: queries that have a place to be found, whether or not the nearest
            one is it. All correct ones by default, as in scikit-learn and in STUN's evaluation, whose recall ends at 1.
        weights: (N,) weights ≥ 0; all are 1 by default.

    ValueError for a score that is NaN.
    """
    counts = ScoreCounter(scores, correct).counts(weights)
    return precision_recall_of(counts, float(counts.positives.sum()) if relevant is None else relevant)


def precision_recall_of(counts: ScoreCounts, relevant: float) -> PrecisionRecallCurve:
    """The curve of scores that are counted already, labelled by whether what is accepted is correct."""
    possible = np.isfinite(counts.scores) & (counts.samples > 0.0)
    accepted, true_positives = (np.cumsum(part[possible]) for part in (counts.samples, counts.positives))
    return PrecisionRecallCurve(counts.scores[possible], accepted, true_positives, relevant)
