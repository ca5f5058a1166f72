"""The static threshold that keeps a given error rate, and the rates to expect with it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.clustered_bound import clustered_upper_bound
from offradar_ros.calibration.conformal import risk_bound
from offradar_ros.calibration.error_control import (
    Counts,
    counts_at,
    fewest_answers,
    interval,
    passing,
    upper_bound,
)
from offradar_ros.calibration.validation_queries import ValidationQueries
from offradar_ros.errors import DataError


@dataclasses.dataclass(frozen=True, eq=False)
class ThresholdChoice:
    """The chosen threshold, and the queries it was chosen from.

    Attributes:
        queries: all of them.
        thresholds: (N + 1,) float64, ascending.
        counts: answered scans and wrong answers at each of them.
        level: n, the row of `thresholds` that is chosen.
        error_rate: ε, the share of the answers that may be wrong.
        confidence: that at most ε of the answers are wrong.
    """

    queries: ValidationQueries
    thresholds: NDArray[np.float64]
    counts: Counts
    level: int
    error_rate: float
    confidence: float

    @property
    def threshold(self) -> float:
        """The U above which a scan is rejected."""
        return float(self.thresholds[self.level])

    @property
    def answered(self) -> int:
        """Scans at or below the threshold."""
        return int(self.counts.answered[self.level])

    @property
    def wrong(self) -> int:
        """Answers among them that are wrong."""
        return int(self.counts.wrong[self.level])

    @property
    def rejection(self) -> tuple[float, float, float]:
        """Share of all scans that is rejected, and both ends of its confidence interval."""
        rejected = len(self.queries) - self.answered
        return (rejected / len(self.queries), *interval(rejected, len(self.queries), self.confidence))

    @property
    def chance_of_wrong_answer(self) -> float:
        """Bound by conformal risk control on the chance that one more exchangeable scan is answered, and wrongly.

        Never above ε, because it is below the bound that the level passed with: so `risk_bound` holds, too.
        """
        return risk_bound(self.wrong, len(self.queries))

    @property
    def squares(self) -> int:
        """Number of squares of ground with an answered scan."""
        return len(np.unique(self.queries.squares[self._accepted]))

    @property
    def error_rate_by_squares(self) -> float:
        """Upper bound on the share of wrong answers if a square, not a scan, is one draw; for this threshold alone."""
        count = int(self.queries.squares.max()) + 1
        accepted, wrong = self._accepted, self._accepted & self.queries.wrong
        answered, mistakes = (np.bincount(self.queries.squares[rows], minlength=count) for rows in (accepted, wrong))
        return clustered_upper_bound(answered, mistakes, self.confidence)

    @property
    def _accepted(self) -> NDArray[np.bool_]:
        accepted: NDArray[np.bool_] = self.queries.uncertainties <= self.threshold
        return accepted


def choose_threshold(
    queries: ValidationQueries, thresholds: NDArray[np.float64], error_rate: float, confidence: float
) -> ThresholdChoice:
    """The highest of the (N + 1,) thresholds that pass (`error_control.passing`).

    DataError where none passes, with the best bound that was reached: a threshold that fails must not be taken for one
    that keeps the error rate.
    """
    counts = counts_at(queries.uncertainties, queries.wrong, thresholds)
    passed = np.flatnonzero(passing(counts, error_rate, confidence))
    if not len(passed):
        raise DataError(_nothing_passes(counts, error_rate, confidence))
    return ThresholdChoice(queries, thresholds, counts, int(passed[-1]), error_rate, confidence)


def _nothing_passes(counts: Counts, error_rate: float, confidence: float) -> str:
    needed, had = fewest_answers(error_rate, confidence), int(counts.answered[-1])
    wanted = f'wrong answers at {error_rate:g} or fewer with confidence {confidence:g}'
    if had < needed:
        return (
            f'{wanted}: expected at least {needed} scans that can be answered, got {had}: drive further or more often'
        )
    bounds = [
        upper_bound(k, n, confidence) for k, n in zip(counts.wrong.tolist(), counts.answered.tolist(), strict=True)
    ]
    best = int(np.argmin(bounds))
    return (
        f'no threshold is sure to keep {wanted}: at best {counts.wrong[best]} of {counts.answered[best]} answers are '
        f'wrong, by itself up to {bounds[best]:.3f} with that confidence, and more as one chosen of several: more '
        'drives, a better encoder or a higher --error-rate'
    )
