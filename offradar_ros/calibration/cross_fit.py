"""Coefficients learned from left-out stretches of a road, and probabilities in which no scan judges itself."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.confidence_fit import fit_confidence, scales_of
from offradar_ros.calibration.left_out_queries import LeftOutQueries
from offradar_ros.config import ConfidenceConfig
from offradar_ros.retrieval.confidence import log_odds, terms_of


@dataclasses.dataclass(frozen=True, eq=False)
class CrossFit:
    """What R left-out queries teach.

    Attributes:
        queries: the queries.
        coefficients: learned from all of them.
        log_odds: (R,) float64 that each answer is right, by coefficients learned without the scans of its stretch.
    """

    queries: LeftOutQueries
    coefficients: ConfidenceConfig
    log_odds: NDArray[np.float64]

    @property
    def p_right(self) -> NDArray[np.float64]:
        """(R,) float64 cross-fitted probability that each answer is right."""
        p_right: NDArray[np.float64] = 0.5 * (1.0 + np.tanh(0.5 * self.log_odds))
        return p_right


def cross_fit(queries: LeftOutQueries, prior: ConfidenceConfig | None) -> CrossFit:
    """Learn coefficients, drawn to those of `prior` if there is one, whose scales are kept; of any model otherwise."""
    scales = scales_of(queries.evidence, '') if prior is None else prior
    terms = terms_of(queries.evidence, scales)

    def learned(rows: NDArray[np.bool_]) -> ConfidenceConfig:
        return fit_confidence(terms[rows], queries.right[rows], np.ones(int(rows.sum())), scales, prior)

    crossed = np.empty(len(queries))
    for stretch in np.unique(queries.stretch):
        here = queries.stretch == stretch
        crossed[here] = log_odds(queries.evidence, learned(~here))[here]
    return CrossFit(queries, learned(np.ones(len(queries), np.bool_)), crossed)
