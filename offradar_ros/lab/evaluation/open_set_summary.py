"""Figures of right answers against wrong ones and queries off the map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.probability_scores import brier_score, expected_calibration_error
from offradar_ros.lab.evaluation.answers import Answers, pair_numbers
from offradar_ros.lab.evaluation.confidences import confidences, known_confidences
from offradar_ros.lab.evaluation.gate import Gate
from offradar_ros.lab.evaluation.metrics.accepted_at_precision import accepted_at_precision
from offradar_ros.lab.evaluation.metrics.auroc import auroc_of
from offradar_ros.lab.evaluation.metrics.bootstrap import bootstrap_interval
from offradar_ros.lab.evaluation.metrics.pair_level import RECALLS, precisions_at
from offradar_ros.lab.evaluation.metrics.precision_recall import precision_recall
from offradar_ros.lab.evaluation.metrics.risk_coverage import augrc, aurc
from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.results.open_set import AtPrecision, ConfidenceFigures, GateFigures, OpenSetFigures

PRECISIONS = (0.95, 0.99, 0.999)
"""Precisions at which figures are reported."""


def summarise_open_set(several: Sequence[Answers], gate: Gate, protocol: Protocol) -> OpenSetFigures:
    """Figures of one method and one map spacing over all queries of `several` answers (at least one)."""
    right = np.concatenate([answers.correct for answers in several])
    on_map = np.concatenate([answers.positive for answers in several])
    clean = np.concatenate([answers.severities for answers in several]) == 0.0
    p_right = np.concatenate([gate.p_right(answers) for answers in several])
    answered = np.concatenate([gate.answered(answers) for answers in several])
    columns = [confidences(answers, gate.coefficients) for answers in several]
    known, pairs = ~np.isnan(p_right), pair_numbers(several)
    rule, limit = ('p_right', gate.min_probability) if gate.by_probability else ('U', gate.threshold)
    return OpenSetFigures(
        on_map=int(on_map.sum()),
        off_map=int((~on_map).sum()),
        confidences={
            name: confidence_figures(np.concatenate([part[name] for part in columns]), right, on_map, pairs, protocol)
            for name in known_confidences(gate.coefficients)
        },
        ece=expected_calibration_error(p_right[known], right[known]) if known.any() else math.nan,
        brier=brier_score(p_right[known], right[known]) if known.any() else math.nan,
        gate=gate_figures('none' if math.isnan(limit) else rule, limit, answered, right, on_map, clean),
    )


def confidence_figures(
    confidence: NDArray[np.float64],
    right: NDArray[np.bool_],
    on_map: NDArray[np.bool_],
    pairs: NDArray[np.intp],
    protocol: Protocol,
) -> ConfidenceFigures:
    """Figures of a confidence in N answers, −∞ where there is none.

    Args:
        confidence: (N,) higher for a surer answer.
        right: (N,) whether the answer is right.
        on_map: (N,) whether the query is on the map.
        pairs: (N,) number of the pair of drives.
        protocol: with the draws and the seed of the interval.
    """
    counter = ScoreCounter(-confidence, ~right)
    low, high = bootstrap_interval(
        pairs, lambda weights: auroc_of(counter.counts(weights)), resamples=protocol.resamples, seed=protocol.seed
    )
    detection = precision_recall(np.maximum(confidence, np.finfo(np.float64).min), ~right)
    curve = precision_recall(-confidence, right, float(on_map.sum()))
    return ConfidenceFigures(
        auroc=Interval(auroc_of(counter.counts()), low, high),
        average_precision=detection.average_precision,
        at_precision=tuple(_at_precision(confidence, right, on_map, precision) for precision in PRECISIONS),
        aurc=aurc(confidence, right),
        augrc=augrc(confidence, right),
        precisions=tuple(np.round(precisions_at(curve, RECALLS), 4).tolist()) if on_map.any() else (),
    )


def _at_precision(
    confidence: NDArray[np.float64], right: NDArray[np.bool_], on_map: NDArray[np.bool_], precision: float
) -> AtPrecision:
    accepted = accepted_at_precision(confidence, right, precision)
    return AtPrecision(precision, share(accepted[right]), share(accepted[~on_map]))


def gate_figures(
    rule: str,
    limit: float,
    answered: NDArray[np.bool_],
    right: NDArray[np.bool_],
    on_map: NDArray[np.bool_],
    clean: NDArray[np.bool_],
) -> GateFigures:
    """What a rule with this limit answers of N queries; all arrays are (N,) bool."""
    return GateFigures(
        rule=rule,
        limit=limit,
        answers=int(answered.sum()),
        answered_on_map=share(answered[on_map]),
        answered_on_map_clean=share(answered[on_map & clean]),
        answered_off_map=share(answered[~on_map]),
        wrong=share(~right[answered]),
        right_rejected=share(~answered[right]),
    )


def share(chosen: NDArray[np.bool_]) -> float:
    """The share that is true; NaN of none."""
    return float(chosen.mean()) if len(chosen) else math.nan
