"""Confidences in answers, which are compared with one another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.retrieval.confidence import log_odds

CONFIDENCES = {
    'U': 'U of the scan',
    'distance': 'distance',
    'pa_ratio': 'PA ratio',
    'spatial_ratio': 'spatial ratio',
    'place_ratio': 'place ratio',
    'sue': 'SUE',
    'p_right': 'p_right',
}
"""Names of the confidences, and those that tables have.

With d₁ the distance of the nearest place in embedding space: U; d₁; d₁ over the distance of the second nearest place
(perceptual aliasing), of the nearest place elsewhere, and over that from the place to the nearest place elsewhere;
`spatial_variance` of the nearest places; and the probability that the answer is right.
"""


def known_confidences(coefficients: ConfidenceConfig | None) -> tuple[str, ...]:
    """Those of `CONFIDENCES` that are known: the last needs coefficients for the model."""
    return tuple(name for name in CONFIDENCES if coefficients or name != 'p_right')


def confidences(answers: Answers, coefficients: ConfidenceConfig | None) -> dict[str, NDArray[np.float64]]:
    """Each known confidence, (Q,): higher for a surer answer, −∞ where there is no answer."""
    names = known_confidences(coefficients)
    found = np.full((len(names), len(answers.ranks)), -math.inf)
    if answers.signals:
        evidence, second, variance_m2 = answers.signals
        others = (second, evidence.distance_apart, evidence.place_distance_apart)
        # Where both distances are 0 the ratio is 0, as at any exact match.
        ratios = [evidence.distance / np.maximum(other, np.finfo(np.float64).tiny) for other in others]
        columns = [evidence.uncertainty, evidence.distance, *ratios, variance_m2]
        if coefficients:
            columns.append(-log_odds(evidence, coefficients))
        found[:, answers.answerable] = -np.array(columns)
    return dict(zip(names, found, strict=True))
