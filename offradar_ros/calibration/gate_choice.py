"""The least probability to answer with that keeps wrong answers rare, and answers off the map rare, too."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.clustered_bound import clustered_upper_bound
from offradar_ros.calibration.cross_fit import CrossFit
from offradar_ros.calibration.error_control import (
    Counts,
    ErrorLimit,
    counts_at,
    fewest_answers,
    passing,
    upper_bound,
)
from offradar_ros.errors import DataError

PROBABILITIES = np.array([0.999, 0.998, 0.995, 0.99, 0.98, 0.97, 0.95, 0.93, 0.9, 0.85, 0.8, 0.75, 0.7, 0.6, 0.5])
"""The gates that are tested, fixed before any scan is seen. An answer less probable than not is never given."""


@dataclasses.dataclass(frozen=True, eq=False)
class GateChoice:
    """The chosen gate, and what it was chosen from.

    Attributes:
        fit: the left-out queries and their cross-fitted probabilities.
        answers: at each of `PROBABILITIES`, of one search of each scan (`LeftOutQueries.mixed`): how many are answered,
            and how many of these answers are wrong.
        off_map: the same of the scans off the map (`LeftOutQueries.off_map`): how many there are, and how many of them
            are answered.
        row: of `PROBABILITIES`, that is chosen.
        limit: what it keeps.
    """

    fit: CrossFit
    answers: Counts
    off_map: Counts
    row: int
    limit: ErrorLimit

    @property
    def min_probability(self) -> float:
        """A query whose answer is right with a lower probability is rejected."""
        return float(PROBABILITIES[self.row])

    @property
    def answered(self) -> int:
        """Answers to one search of each scan."""
        return int(self.answers.answered[self.row])

    @property
    def wrong(self) -> int:
        """Wrong ones among them."""
        return int(self.answers.wrong[self.row])

    @property
    def off_map_scans(self) -> int:
        """Scans that are off the map in one half or in both."""
        return int(self.off_map.answered[self.row])

    @property
    def off_map_answered(self) -> int:
        """Those of them that are answered."""
        return int(self.off_map.wrong[self.row])

    @property
    def squares(self) -> int:
        """Number of squares of ground with an answer."""
        return len(np.unique(self.fit.queries.square[self._accepted]))

    @property
    def error_rate_by_squares(self) -> float:
        """Upper bound on the share of wrong answers if a square, not a scan, is one draw; for this gate alone."""
        queries, accepted = self.fit.queries, self._accepted
        count, mistaken = int(queries.square.max()) + 1, accepted[~self.fit.right[accepted]]
        answered, wrong = (np.bincount(queries.square[rows], minlength=count) for rows in (accepted, mistaken))
        return clustered_upper_bound(answered, wrong, self.limit.confidence)

    @property
    def _accepted(self) -> NDArray[np.intp]:
        mixed = self.fit.queries.mixed
        accepted: NDArray[np.intp] = mixed[_scores(self.fit)[mixed] <= _thresholds()[self.row]]
        return accepted


def confidence_of_each(limit: ErrorLimit) -> float:
    """Confidence of each of the two promises with which both are kept with that of `limit` (Bonferroni)."""
    return (1.0 + limit.confidence) / 2.0


def choose_gate(fit: CrossFit, limit: ErrorLimit) -> GateChoice:
    """The lowest of `PROBABILITIES` with which both promises pass (`error_control.passing`), each with half of 1 − c.

    The share of the scans off the map that are answered grows as the gate falls, so the tests of `passing`, from the
    highest gate down with all scans counted at each, need no correction.

    DataError where none passes, with what is missing: too few scans for a promise, or the best bounds reached.
    """
    queries, scores, each = fit.queries, _scores(fit), confidence_of_each(limit)
    mixed, off = queries.mixed, queries.off_map
    answers = counts_at(scores[mixed], ~fit.right[mixed], _thresholds())
    answered_off = counts_at(scores[off], np.ones(len(off), np.bool_), _thresholds()).answered
    off_map = Counts(np.full(len(answered_off), len(off), np.int64), answered_off)
    kept = passing(answers, limit.error_rate, each) & passing(off_map, limit.off_map_rate, each)
    if not kept.any():
        raise DataError(_nothing_passes(answers, off_map, limit))
    return GateChoice(fit, answers, off_map, int(np.flatnonzero(kept)[-1]), limit)


def _scores(fit: CrossFit) -> NDArray[np.float64]:
    """(R,) a query is answered where this is at most the threshold, as U is."""
    return -fit.p_right


def _thresholds() -> NDArray[np.float64]:
    return -PROBABILITIES


def _nothing_passes(answers: Counts, off_map: Counts, limit: ErrorLimit) -> str:
    each = confidence_of_each(limit)
    needed, scans = fewest_answers(limit.off_map_rate, each), int(off_map.answered[-1])
    wanted = f'answers off the map at {limit.off_map_rate:g} or fewer with confidence {limit.confidence:g} of all'
    if scans < needed:
        possible = 1.0 - (1.0 - each) ** (1.0 / scans)
        return (
            f'{wanted}: expected at least {needed} scans that are off the map when a half is left out, got {scans}: '
            f'drive further or more often, or --off-map-rate {np.ceil(possible * 1e4) / 1e4:g} or higher'
        )
    needed, answered = fewest_answers(limit.error_rate, each), int(answers.answered[-1])
    wanted = f'wrong answers at {limit.error_rate:g} or fewer with confidence {limit.confidence:g} of all'
    if answered < needed:
        return f'{wanted}: expected at least {needed} answers, got {answered}: drive further or more often'
    wrong, off = (
        min(upper_bound(k, n, each) for k, n in zip(counts.wrong.tolist(), counts.answered.tolist(), strict=True))
        for counts in (answers, off_map)
    )
    return (
        f'no probability up to {PROBABILITIES[0]:g} is sure to keep both {limit.error_rate:g} of the answers wrong and '
        f'{limit.off_map_rate:g} of the scans off the map answered: at best, each by itself, up to {wrong:.3f} and '
        f'{off:.3f}: more drives, a better encoder or a higher --error-rate or --off-map-rate'
    )
