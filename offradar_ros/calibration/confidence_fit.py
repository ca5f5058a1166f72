"""Fits the coefficients of the probability that an answer is right. scipy is imported when they are fitted."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import DataError
from offradar_ros.retrieval.confidence import TERMS

RIDGE = 1.0
"""Weight of the squares of the standardised coefficients, in queries: it matters where hardly an answer is wrong."""


def fit_confidence(
    terms: NDArray[np.float64],
    right: NDArray[np.bool_],
    weights: NDArray[np.float64],
    scales: ConfidenceConfig,
) -> ConfidenceConfig:
    """Coefficients of highest likelihood, none of them positive, of answers that are right or wrong.

    No coefficient is positive, so that more of any term never makes an answer more probable (logistic regression with
    bounds, L-BFGS-B).

    Args:
        terms: (Q, 5) float64, from `confidence.terms_of` with the same `scales`.
        right: (Q,) whether the answer is right.
        weights: (Q,) float64, how much each query counts.
        scales: the other values of the result.

    DataError if no answer is right, or none is wrong.
    """
    from scipy.optimize import minimize  # noqa: PLC0415

    if right.all() or not right.any():
        raise DataError(
            f'expected right and wrong answers to learn from, got {int(right.sum())} right of {len(right)}: leave out '
            'a part of the map, or drive further'
        )
    weights = weights * (len(weights) / weights.sum())
    mean = np.average(terms, axis=0, weights=weights)
    spread = np.sqrt(np.average((terms - mean) ** 2, axis=0, weights=weights))
    spread[spread == 0.0] = 1.0
    design = np.column_stack([np.ones(len(terms)), (terms - mean) / spread])
    signs = np.where(right, 1.0, -1.0)

    def loss(vector: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        margins = signs * (design @ vector)
        ridge = np.concatenate([[0.0], vector[1:]]) * RIDGE
        # d/dm ln(1 + exp(−m)) = −1 / (1 + exp(m))
        slopes = -weights * signs * 0.5 * (1.0 - np.tanh(0.5 * margins))
        value = float(weights @ np.logaddexp(0.0, -margins) + 0.5 * ridge @ vector)
        return value, design.T @ slopes + ridge

    start = np.zeros(design.shape[1])
    found = minimize(loss, start, jac=True, method='L-BFGS-B', bounds=[(None, None), *[(None, 0.0)] * len(TERMS)])
    coefficients = np.minimum(found.x[1:], 0.0) / spread
    values = dict(zip(TERMS, coefficients.tolist(), strict=True))
    return dataclasses.replace(scales, intercept=float(found.x[0] - coefficients @ mean), **values)
