"""What decides whether a query is answered, as on the vehicle (`query.gate`)."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.retrieval.confidence import confidence_for, probability


@dataclasses.dataclass(frozen=True)
class Gate:
    """The gate of one method.

    Attributes:
        coefficients: of the probability that an answer is right; None if there are none for the model.
        min_probability: an answer of a lower probability is rejected; NaN where the rule on U decides.
        threshold: on U; NaN for none, so that every query is answered.
    """

    coefficients: ConfidenceConfig | None = None
    min_probability: float = math.nan
    threshold: float = math.nan

    @property
    def by_probability(self) -> bool:
        """Whether the probability decides."""
        return self.coefficients is not None and not math.isnan(self.min_probability)

    def p_right(self, answers: Answers) -> NDArray[np.float64]:
        """(Q,) the probability that each answer is right; NaN where it is unknown, or there is no answer."""
        found = np.full(len(answers.ranks), math.nan)
        if self.coefficients and answers.signals:
            found[answers.answerable] = probability(answers.signals.evidence, self.coefficients)
        return found

    def answered(self, answers: Answers) -> NDArray[np.bool_]:
        """(Q,) whether each query is answered."""
        if self.by_probability:
            return self.p_right(answers) >= self.min_probability
        limit = math.inf if math.isnan(self.threshold) else self.threshold
        return answers.answerable & (answers.uncertainties <= limit)


def gate_of(query: QueryConfig, model: str, threshold: float) -> Gate:
    """The gate for the model with this fingerprint, without alignments, and a `threshold` on U (NaN for none)."""
    least = max(query.min_probability, query.min_probability_unaligned) if query.gate == 'probability' else math.nan
    return Gate(confidence_for(model, query.confidence), least, threshold)
