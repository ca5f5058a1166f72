"""Figures of answers whose nearest places were aligned with the query."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig
from offradar_ros.lab.evaluation.aligned import AlignedAnswers
from offradar_ros.lab.evaluation.metrics.accepted_at_precision import accepted_at_precision
from offradar_ros.lab.evaluation.metrics.auroc import auroc
from offradar_ros.lab.evaluation.open_set_summary import share
from offradar_ros.lab.evaluation.results.alignments import (
    AlignmentFigures,
    AnswerFigures,
    PoseFigures,
    RecallAtPrecision,
)

PRECISIONS = (0.99, 0.999)
"""Precisions at which recall is reported."""
RANGES_M = ((0.0, 2.0), (2.0, 5.0), (5.0, 10.0), (10.0, 15.0), (15.0, 25.0))
NEAR_M = 10.0
"""Poses by direction and fault are those at places within this."""
GROSS_M, GROSS_DEG = 2.0, 2.0
"""A pose that is farther off than this is wrong, whatever its covariance."""
FINE_M, FINE_DEG = 0.5, 0.5
OTHER_WAY_RAD = math.radians(120.0)
"""Headings that differ by more than this are those of a road that is driven the other way."""
LANE_M = 2.0
"""A vehicle farther than this to the side of the place is in another lane."""
HELD_95 = 7.814727903
"""Squared errors, in units of their covariance, up to this are in the 95 % ellipsoid: χ² of three dimensions."""
OTHER_WAY = 'the other way'


def alignment_figures(
    answers: AlignedAnswers, coefficients: ConfidenceConfig | None, tolerance_m: float
) -> AlignmentFigures:
    """All figures of answers; those of the order and the probability need coefficients for the score."""
    known = coefficients is not None and coefficients.score != 0.0
    return AlignmentFigures(
        answer_figures(answers, coefficients, tolerance_m) if coefficients and known else None,
        poses_by_distance(answers),
        poses_by_way(answers),
        poses_by_fault(answers),
    )


class FirstPlaces(NamedTuple):
    """The first place of each of Q queries, in one way of ordering places.

    Attributes:
        log_odds: (Q,) float64, that it is right.
        right: (Q,) whether it is.
        scores: (Q,) float64 of its alignment; NaN for none.
    """

    log_odds: NDArray[np.float64]
    right: NDArray[np.bool_]
    scores: NDArray[np.float64]


def first_places(
    answers: AlignedAnswers, coefficients: ConfidenceConfig, tolerance_m: float
) -> tuple[FirstPlaces, FirstPlaces]:
    """The answers by distance alone, and with alignments."""
    judged = answers.judged(tolerance_m)
    firsts, by_distance = judged.firsts(coefficients), judged.by_distance(coefficients)[:, 0]
    scores = answers.scores[np.arange(len(answers)), firsts.columns]
    return (
        FirstPlaces(by_distance, judged.right[:, 0], answers.scores[:, 0]),
        FirstPlaces(firsts.log_odds, firsts.right, scores),
    )


def answer_figures(answers: AlignedAnswers, coefficients: ConfidenceConfig, tolerance_m: float) -> AnswerFigures:
    """What at least one query is answered, by distance alone and with alignments."""
    right, on_map = answers.away_m <= tolerance_m, answers.on_map
    before, after = first_places(answers, coefficients, tolerance_m)
    scored = np.isfinite(after.scores)

    def recall(found: FirstPlaces, precision: float) -> float:
        return share((accepted_at_precision(found.log_odds, found.right, precision) & found.right)[on_map])

    return AnswerFigures(
        queries=len(answers),
        on_map=int(on_map.sum()),
        places=right.shape[1],
        recall_at_1_by_distance=share(before.right[on_map]),
        recall_at_1_aligned=share(after.right[on_map]),
        recall_at_k=share(np.any(right[on_map], axis=1)),
        recall_at_10=share(answers.in_ten[on_map]),
        at_precision=tuple(
            RecallAtPrecision(precision, recall(before, precision), recall(after, precision))
            for precision in PRECISIONS
        ),
        auroc_score=auroc(after.scores[scored], after.right[scored]),
        auroc_p_by_distance=auroc(before.log_odds, before.right),
        auroc_p_aligned=auroc(after.log_odds, after.right),
    )


def poses_by_distance(answers: AlignedAnswers) -> dict[str, PoseFigures]:
    """Errors on clean scans by the distance of the place on the ground, in its direction and then the other way."""
    away_m, clean, other_way = answers.away_m, _clean(answers), _other_way(answers)
    within = {f'{low:g} to {high:g} m': (away_m >= low) & (away_m < high) & clean for low, high in RANGES_M}
    return _of_parts(
        answers,
        {name: part & ~other_way for name, part in within.items()}
        | {f'{name}, {OTHER_WAY}': part & other_way for name, part in within.items()},
    )


def poses_by_way(answers: AlignedAnswers) -> dict[str, PoseFigures]:
    """Errors on clean scans near the place, by direction and lane."""
    near, other_way = (answers.away_m <= NEAR_M) & _clean(answers), _other_way(answers)
    beside = np.abs(answers.truths[..., 1]) > LANE_M
    parts = {
        'same way, same lane': near & ~other_way & ~beside,
        'same way, other lane': near & ~other_way & beside,
        OTHER_WAY: near & other_way,
    }
    return _of_parts(answers, parts)


def poses_by_fault(answers: AlignedAnswers) -> dict[str, PoseFigures]:
    """Errors on degraded scans near the place, by their kind."""
    near, kinds = answers.away_m <= NEAR_M, answers.kinds[:, None]
    return _of_parts(answers, {kind: near & (kinds == kind) for kind in np.unique(answers.kinds).tolist() if kind})


def pose_figures(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> PoseFigures:
    """Figures of N > 0 errors, (N, 3) float64 in metres and radians, and their (N, 3, 3) covariances."""
    distance_m, angle_deg = np.hypot(errors[:, 0], errors[:, 1]), np.degrees(np.abs(errors[:, 2]))
    right, fine = is_right(errors), is_right(errors, FINE_M, FINE_DEG)
    squares = squared(errors[right], covariances[right])
    return PoseFigures(
        pairs=len(errors),
        right=share(right),
        median_m=float(np.median(distance_m)),
        quantile_90_m=float(np.quantile(distance_m, 0.9)),
        median_deg=float(np.median(angle_deg)),
        quantile_90_deg=float(np.quantile(angle_deg, 0.9)),
        within_half=share(fine),
        nees=float(squares.mean()) / 3.0 if len(squares) else math.nan,
        in_ellipsoid=share(squares <= HELD_95),
    )


def is_right(errors: NDArray[np.float64], most_m: float = GROSS_M, most_deg: float = GROSS_DEG) -> NDArray[np.bool_]:
    """(...,) whether poses with (..., 3) errors in metres and radians are at most this far off; none of NaN is."""
    near: NDArray[np.bool_] = np.hypot(errors[..., 0], errors[..., 1]) <= most_m
    turned: NDArray[np.bool_] = np.abs(errors[..., 2]) <= math.radians(most_deg)
    return near & turned


def squared(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) float64 eᵀ Σ⁻¹ e of (N, 3) errors and their (N, 3, 3) covariances."""
    squares: NDArray[np.float64] = np.einsum('ni,nij,nj->n', errors, np.linalg.inv(covariances), errors)
    return squares


def _of_parts(answers: AlignedAnswers, parts: dict[str, NDArray[np.bool_]]) -> dict[str, PoseFigures]:
    # Errors are unknown where nothing was aligned, and where a heading is.
    known = np.isfinite(answers.errors).all(axis=-1)
    return {
        name: pose_figures(answers.errors[part & known], answers.covariances[part & known])
        for name, part in parts.items()
        if (part & known).any()
    }


def _clean(answers: AlignedAnswers) -> NDArray[np.bool_]:
    clean: NDArray[np.bool_] = (answers.kinds == '')[:, None]
    return clean


def _other_way(answers: AlignedAnswers) -> NDArray[np.bool_]:
    turned: NDArray[np.bool_] = np.abs(answers.truths[..., 2]) > OTHER_WAY_RAD
    return turned
