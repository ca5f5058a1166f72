"""The probability that an answer is right: a logistic model of a few readable terms."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig
from offradar_ros.records import read_record
from offradar_ros.retrieval.evidence import EvidenceTable
from offradar_ros.shipped import shipped_files
from offradar_ros.types import Evidence

TERMS = ('distance', 'spatial_ratio', 'place_ratio', 'uncertainty', 'place_uncertainty')
"""The terms of the log-odds, in the order of the columns of `terms_of`."""

_LEAST = 1e-9
"""Smaller distances and variances count as this: their logarithm stays finite."""


def terms_of(evidence: Evidence | EvidenceTable, scales: ConfidenceConfig) -> NDArray[np.float64]:
    """(5,) or (Q, 5) float64: the values that the coefficients of `TERMS` multiply.

    With d₁ the distance, d₂ that of the nearest place elsewhere, and d₃ that from the place to the nearest elsewhere:

        d₁,  ln(d₁ / d₂),  ln(d₁ / d₃),  ln(U / u),  ln(U of the place / u)

    where u is the usual U of the sensor. d₂ and d₃ are at most the distance that is typical of different places.

    Both ratios compare distances that become smaller together as a map grows. Off the map, d₁ and d₂ are the smallest
    of many distances, of which their ratio depends little on how many there are.
    """
    d1, d2, d3, u, place_u = (
        np.maximum(column, _LEAST)
        for column in (
            np.asarray(evidence.distance, np.float64),
            np.minimum(evidence.distance_apart, scales.unrelated_distance),
            np.minimum(evidence.place_distance_apart, scales.unrelated_distance),
            np.asarray(evidence.uncertainty, np.float64) / scales.usual_uncertainty,
            np.asarray(evidence.place_uncertainty, np.float64) / scales.usual_uncertainty,
        )
    )
    terms: NDArray[np.float64] = np.stack(
        [np.asarray(evidence.distance, np.float64), np.log(d1 / d2), np.log(d1 / d3), np.log(u), np.log(place_u)],
        axis=-1,
    )
    return terms


def log_odds(evidence: Evidence | EvidenceTable, coefficients: ConfidenceConfig) -> NDArray[np.float64]:
    """() or (Q,) float64 log-odds that the nearest place is right; finite."""
    terms = terms_of(evidence, coefficients)
    total = np.full(terms.shape[:-1], coefficients.intercept)
    for column, term in enumerate(TERMS):
        total = total + getattr(coefficients, term) * terms[..., column]
    return total


def verified(
    odds: NDArray[np.float64],
    scores: NDArray[np.float64] | float,
    elsewhere: NDArray[np.float64] | float,
    coefficients: ConfidenceConfig,
) -> NDArray[np.float64]:
    """The log-odds with alignments, too, in the shape of `odds`; unchanged where the score is NaN.

    They are ``a + b · odds + c · score + d · elsewhere``, with `verified_intercept`, `verified_log_odds`, `score`,
    `score_elsewhere`, and the scores of `scores_elsewhere`; c = 0 leaves all alignments out.
    """
    if not coefficients.score:
        return odds
    with_score = (
        coefficients.verified_intercept
        + coefficients.verified_log_odds * odds
        + coefficients.score * scores
        + coefficients.score_elsewhere * elsewhere
    )
    return np.where(np.isnan(scores), odds, with_score)


def logistic(odds: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """The probability of log-odds, in a form that does not overflow."""
    p_right: NDArray[np.float64] = 0.5 * (1.0 + np.tanh(0.5 * np.asarray(odds)))
    return p_right


def probability(evidence: Evidence | EvidenceTable, coefficients: ConfidenceConfig) -> NDArray[np.float64]:
    """() or (Q,) float64 in [0, 1]: the probability that the nearest place is within the tolerance of the vehicle."""
    return logistic(log_odds(evidence, coefficients))


class SimilarPlaces(NamedTuple):
    """The places within the tolerance of the one found, as evidence for a belief over many scans.

    Attributes:
        place_ids: (M,) int64.
        log_odds: (M,) float64, that the answer is right, if it had the distance of each place. The greatest is that of
            the place found.
        base_rate: share of right answers for which the log-odds are.
    """

    place_ids: NDArray[np.int64]
    log_odds: NDArray[np.float64]
    base_rate: float


def similar_places(
    place_ids: NDArray[np.int64], distances: NDArray[np.float32], evidence: Evidence, coefficients: ConfidenceConfig
) -> SimilarPlaces:
    """What (M,) places near the one found, at (M,) distances in embedding space, and the evidence for it tell."""
    rest = [getattr(evidence, field.name) for field in dataclasses.fields(evidence)[1:]]
    columns = (np.full(len(distances), value, np.float64) for value in rest)
    table = EvidenceTable(place_ids, distances.astype(np.float64), *columns)
    return SimilarPlaces(place_ids, log_odds(table, coefficients), coefficients.base_rate)


def without_rival(evidence: Evidence) -> Evidence:
    """The evidence if no place elsewhere resembled the query or the place found."""
    return dataclasses.replace(evidence, distance_apart=math.inf, place_distance_apart=math.inf)


@functools.cache
def shipped_confidences() -> dict[str, ConfidenceConfig]:
    """Coefficients in ``params/confidence`` by the fingerprint of their model."""
    records = [read_record(ConfidenceConfig, path) for path in shipped_files('confidence')]
    return {record.model: record for record in records}


def confidence_for(model: str, configured: ConfidenceConfig) -> ConfidenceConfig | None:
    """The coefficients for a model: the configured ones if they are for it, else the shipped; None if there is none."""
    if configured.model:
        return configured if configured.model == model else None
    return shipped_confidences().get(model)
