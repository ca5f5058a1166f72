"""Fits the coefficients of the probability that an answer is right. scipy is imported when they are fitted."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import DataError
from offradar_ros.retrieval.confidence import TERMS, verified
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
    from scipy.optimize import minimize  # noqa: PLC0415

    if prior is None and (right.all() or not right.any()):
        raise DataError(
            f'expected right and wrong answers to learn from, got {int(right.sum())} right of {len(right)}: leave out '
            'a part of the map, or drive further'
        )
    weights = weights * (len(weights) / weights.sum())
    mean = np.average(terms, axis=0, weights=weights)
    spread = np.sqrt(np.average((terms - mean) ** 2, axis=0, weights=weights))
    spread[spread == 0.0] = 1.0
    design = np.column_stack([np.ones(len(terms)), (terms - mean) / spread])
    centre, ridge = np.zeros(design.shape[1]), np.full(design.shape[1], RIDGE if prior is None else PRIOR_QUERIES)
    if prior is None:
        ridge[0] = 0.0
    else:
        known = np.array([getattr(prior, name) for name in TERMS])
        centre = np.array([prior.intercept + known @ mean, *(known * spread)])
    signs = np.where(right, 1.0, -1.0)

    def loss(vector: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margins = signs * (design @ vector)
        drawn = ridge * (vector - centre)
        # d/dm ln(1 + exp(−m)) = −1 / (1 + exp(m))
        slopes = -weights * signs * 0.5 * (1.0 - np.tanh(0.5 * margins))
        value = float(weights @ np.logaddexp(0.0, -margins) + 0.5 * drawn @ (vector - centre))
        return value, design.T @ slopes + drawn

    found = minimize(loss, centre, jac=True, method='L-BFGS-B', bounds=[(None, None), *[(None, 0.0)] * len(TERMS)])
    coefficients = np.minimum(found.x[1:], 0.0) / spread
    values = dict(zip(TERMS, coefficients.tolist(), strict=True))
    intercept = float(found.x[0] - coefficients @ mean)
    return dataclasses.replace(scales, base_rate=_base_rate(right, weights, prior), intercept=intercept, **values)


def fit_verified(
    odds: NDArray[np.float64],
    scores: NDArray[np.float64],
    elsewhere: NDArray[np.float64],
    right: NDArray[np.bool_],
    nearest_odds: NDArray[np.float64],
    weights: NDArray[np.float64],
    found: ConfidenceConfig,
) -> ConfidenceConfig:
    """`found`, with the coefficients of highest likelihood of answers whose places were aligned with the query.

    Which place comes first depends on the coefficients, so they are fitted to the first places by the ones before,
    a few times. Their likelihood is that of `fit_confidence`, with bounds at 0, so that each one says what it means.

    Args:
        odds: (Q, k) float64 log-odds of `found` for each of the nearest places, as if it were the answer.
        scores: (Q, k) float64 of the alignments.
        elsewhere: (Q, k) float64, those of `scores_elsewhere`.
        right: (Q, k) whether the place is within the tolerance of the query.
        nearest_odds: (Q, k) float64 log-odds by which the places are ordered: those of the nearest place, with the
            distances of each (`similar_places`).
        weights: (Q,) float64, how much each query counts; their sum is scaled to Q.
        found: all other coefficients.

    DataError if no answer is right, or none is wrong.
    """
    from scipy.optimize import minimize  # noqa: PLC0415

    if right.all() or not right.any():
        raise DataError('expected right and wrong answers to learn from: leave out a part of the map')
    weights = weights * (len(weights) / weights.sum())
    every = np.arange(len(odds))
    for _ in range(_ROUNDS):
        first = np.argmax(verified(nearest_odds, scores, elsewhere, found), axis=1)
        terms = [np.ones(len(odds)), odds[every, first], scores[every, first], elsewhere[every, first]]
        design = np.column_stack(terms)
        signs = np.where(right[every, first], 1.0, -1.0)

        def loss(
            vector: NDArray[np.float64], design: NDArray[np.float64] = design, signs: NDArray[np.float64] = signs
        ) -> tuple[float, NDArray[np.float64]]:
            margins = signs * (design @ vector)
            slopes = -weights * signs * 0.5 * (1.0 - np.tanh(0.5 * margins))
            return float(weights @ np.logaddexp(0.0, -margins)), design.T @ slopes

        bounds = [(None, None), (0.0, None), (0.0, None), (None, 0.0)]
        start = np.array([0.0, 1.0, 0.0, 0.0])
        intercept, by_odds, score, by_elsewhere = minimize(loss, start, jac=True, bounds=bounds).x.tolist()
        found = dataclasses.replace(
            found,
            verified_intercept=intercept,
            verified_log_odds=by_odds,
            score=score,
            score_elsewhere=by_elsewhere,
        )
    return found


def _base_rate(right: NDArray[np.bool_], weights: NDArray[np.float64], prior: ConfidenceConfig | None) -> float:
    """The share of right answers, drawn to that of the prior as the intercept is; never quite 0 or 1."""
    known = PRIOR_QUERIES if prior else 0.0
    of_prior = prior.base_rate if prior else 0.0
    share = (float(weights @ right) + known * of_prior) / (float(weights.sum()) + known)
    return min(max(share, 1e-6), 1.0 - 1e-6)
