"""Coefficients learned from left-out stretches of a road, and probabilities in which no scan judges itself."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.confidence_fit import fit_confidence, fit_verified, scales_of
from offradar_ros.calibration.left_out_queries import LeftOutQueries
from offradar_ros.config import ConfidenceConfig
from offradar_ros.retrieval.confidence import logistic, terms_of


@dataclasses.dataclass(frozen=True, eq=False)
class CrossFit:
    """What R left-out queries teach.

    Attributes:
        queries: the queries.
        coefficients: learned from all of them.
        log_odds: (R,) float64 that each answer is right, by coefficients learned without the scans of its stretch.
        right: (R,) whether it is: which place comes first depends on the coefficients, too.
    """

    queries: LeftOutQueries
    coefficients: ConfidenceConfig
    log_odds: NDArray[np.float64]
    right: NDArray[np.bool_]

    @property
    def p_right(self) -> NDArray[np.float64]:
        """(R,) float64 cross-fitted probability that each answer is right."""
        return logistic(self.log_odds)


def cross_fit(queries: LeftOutQueries, prior: ConfidenceConfig | None) -> CrossFit:
    """Learn coefficients, drawn to those of `prior` if there is one, whose scales are kept; of any model otherwise."""
    scales = scales_of(queries.evidence, '') if prior is None else prior
    terms = terms_of(queries.evidence, scales)

    def learned(rows: NDArray[np.bool_]) -> ConfidenceConfig:
        weights = np.ones(int(rows.sum()))
        found = fit_confidence(terms[rows], queries.right[rows], weights, scales, prior)
        return found if queries.aligned is None else fit_verified(queries.aligned.only(rows), weights, found, prior)

    crossed, right = np.empty(len(queries)), np.empty(len(queries), np.bool_)
    for stretch in np.unique(queries.stretch):
        here = queries.stretch == stretch
        judged = queries.judged(learned(~here))
        crossed[here], right[here] = judged.log_odds[here], judged.right[here]
    return CrossFit(queries, learned(np.ones(len(queries), np.bool_)), crossed, right)
