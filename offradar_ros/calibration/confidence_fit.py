"""Fits the coefficients of the probability that an answer is right. scipy is imported when they are fitted."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.aligned_places import AlignedPlaces
from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import DataError
from offradar_ros.retrieval.confidence import TERMS
from offradar_ros.retrieval.evidence import EvidenceTable

RIDGE = 1.0
"""Weight of the squares of the standardised coefficients, in queries: it matters where hardly an answer is wrong."""

_ROUNDS = 4
"""After so many the first places do not change any more."""

PRIOR_QUERIES = 10.0
"""The same of their differences from known coefficients. A compromise on the worlds of the protocol `confidence`: fewer
queries fit left-out stretches a little better, more of them a road of which only a half was seen."""


def scales_of(evidence: EvidenceTable, model: str) -> ConfidenceConfig:
    """The scales of the terms, from the queries of one road: the usual U, and the typical distance elsewhere."""
    apart = evidence.distance_apart[np.isfinite(evidence.distance_apart)]
    return ConfidenceConfig(
        model=model,
        usual_uncertainty=round(float(np.median(evidence.uncertainty)), 3),
        unrelated_distance=round(float(np.median(apart)), 3) if len(apart) else 1.0,
    )


def fit_confidence(
    terms: NDArray[np.float64],
    right: NDArray[np.bool_],
    weights: NDArray[np.float64],
    scales: ConfidenceConfig,
    prior: ConfidenceConfig | None = None,
) -> ConfidenceConfig:
    """Coefficients of highest likelihood, none of them positive, of answers that are right or wrong.

    No coefficient is positive, so that more of any term never makes an answer more probable (logistic regression with
    bounds, L-BFGS-B). With β the coefficients of the terms scaled to a mean of 0 and a deviation of 1, and β₀ the
    intercept, the loss is

        Σ_q w_q ln(1 + exp(−s_q (β₀ + β·x_q))) + λ/2 |β − β_prior|²,   s_q = 1 if the answer is right, else −1

    where λ is `RIDGE` and β_prior is 0 without a prior; with one, λ is `PRIOR_QUERIES`, and the intercept is drawn to
    that of the prior, too.

    Args:
        terms: (Q, 5) float64, from `confidence.terms_of` with the same `scales`.
        right: (Q,) whether the answer is right.
        weights: (Q,) float64, how much each query counts; their sum is scaled to Q.
        scales: the other values of the result.
        prior: coefficients, for the same scales, that few queries keep and many replace.

    DataError if no answer is right, or none is wrong, and there is no prior.
    """
    if prior is None and (right.all() or not right.any()):
        raise DataError(
            f'expected right and wrong answers to learn from, got {int(right.sum())} right of {len(right)}: leave out '
            'a part of the map, or drive further'
        )
    weights = weights * (len(weights) / weights.sum())
    known = None if prior is None else np.array([prior.intercept, *(getattr(prior, name) for name in TERMS)])
    intercept, *coefficients = _likeliest(terms, right, weights, [-1.0] * len(TERMS), known).tolist()
    found = dataclasses.replace(scales, base_rate=_base_rate(right, weights, prior), intercept=intercept)
    return dataclasses.replace(found, **dict(zip(TERMS, coefficients, strict=True)))


def fit_verified(
    aligned: AlignedPlaces,
    weights: NDArray[np.float64],
    found: ConfidenceConfig,
    prior: ConfidenceConfig | None = None,
) -> ConfidenceConfig:
    """`found`, with the coefficients of highest likelihood of answers whose places were aligned with the query.

    Which place comes first depends on the coefficients, so they are fitted to the first places by the ones before,
    a few times. The loss is that of `fit_confidence`, with bounds at 0, so that each one says what it means. A prior
    that leaves alignments out draws to the log-odds as they are without them.

    Args:
        aligned: Q queries; those of which a place is not aligned are left out.
        weights: (Q,) float64, how much each query counts; their sum is scaled to Q.
        found: all other coefficients.
        prior: coefficients that few queries keep and many replace.

    DataError if no answer is right, or none is wrong, and there is no prior.
    """
    whole = aligned.are_aligned
    aligned, weights = aligned.only(whole), weights[whole]
    if prior is None and (aligned.right.all() or not aligned.right.any()):
        raise DataError('expected right and wrong answers to learn from: leave out a part of the map')
    if not len(aligned):
        return found
    known = None if prior is None else _verified_of(prior)
    found = _with_verified(found, _BY_DISTANCE if known is None else known)
    odds, every = aligned.by_distance(found), np.arange(len(aligned))
    for _ in range(_ROUNDS):
        columns, _, right = aligned.firsts(found)
        terms = [odds[every, columns], aligned.scores[every, columns], aligned.elsewhere[every, columns]]
        found = _with_verified(found, _likeliest(np.column_stack(terms), right, weights, _VERIFIED_WAYS, known))
    return found


_VERIFIED = ('verified_intercept', 'verified_log_odds', 'score', 'score_elsewhere')
_VERIFIED_WAYS = (1.0, 1.0, -1.0)
_BY_DISTANCE = np.array([0.0, 1.0, 0.0, 0.0])
"""These values of them leave alignments out."""


def _verified_of(known: ConfidenceConfig) -> NDArray[np.float64]:
    return np.array([getattr(known, name) for name in _VERIFIED]) if known.score else _BY_DISTANCE


def _with_verified(found: ConfidenceConfig, values: NDArray[np.float64]) -> ConfidenceConfig:
    return dataclasses.replace(found, **dict(zip(_VERIFIED, values.tolist(), strict=True)))


def _likeliest(
    terms: NDArray[np.float64],
    right: NDArray[np.bool_],
    weights: NDArray[np.float64],
    ways: Sequence[float],
    known: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """(n + 1,) the intercept and the coefficients of (Q, n) terms with the least loss of `fit_confidence`.

    A coefficient is not negative where its one of (n,) `ways` is 1, and not positive where it is −1. (n + 1,) `known`
    are those of the prior.
    """
    from scipy.optimize import minimize  # noqa: PLC0415

    weights = weights * (len(weights) / weights.sum())
    mean = np.average(terms, axis=0, weights=weights)
    spread = np.sqrt(np.average((terms - mean) ** 2, axis=0, weights=weights))
    spread[spread == 0.0] = 1.0
    design = np.column_stack([np.ones(len(terms)), (terms - mean) / spread])
    centre, ridge = np.zeros(design.shape[1]), np.full(design.shape[1], RIDGE if known is None else PRIOR_QUERIES)
    if known is None:
        ridge[0] = 0.0
    else:
        centre = np.array([known[0] + known[1:] @ mean, *(known[1:] * spread)])
    signs = np.where(right, 1.0, -1.0)

    def loss(vector: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margins = signs * (design @ vector)
        drawn = ridge * (vector - centre)
        # d/dm ln(1 + exp(−m)) = −1 / (1 + exp(m))
        slopes = -weights * signs * 0.5 * (1.0 - np.tanh(0.5 * margins))
        value = float(weights @ np.logaddexp(0.0, -margins) + 0.5 * drawn @ (vector - centre))
        return value, design.T @ slopes + drawn

    bounds = [(None, None), *((0.0, None) if way > 0.0 else (None, 0.0) for way in ways)]
    vector = minimize(loss, centre, jac=True, method='L-BFGS-B', bounds=bounds).x
    # Without the sign of −0, which would be written to files.
    coefficients = np.maximum(vector[1:] * ways, 0.0) * ways / spread + 0.0
    return np.concatenate([[vector[0] - coefficients @ mean], coefficients])


def _base_rate(right: NDArray[np.bool_], weights: NDArray[np.float64], prior: ConfidenceConfig | None) -> float:
    """The share of right answers, drawn to that of the prior as the intercept is; never quite 0 or 1."""
    known = PRIOR_QUERIES if prior else 0.0
    of_prior = prior.base_rate if prior else 0.0
    share = (float(weights @ right) + known * of_prior) / (float(weights.sum()) + known)
    return min(max(share, 1e-6), 1.0 - 1e-6)
