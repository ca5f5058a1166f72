"""Queries of which the nearest places are aligned with the scan, and what both opinions together say of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.open_set import joined_evidence
from offradar_ros.config import ConfidenceConfig
from offradar_ros.retrieval.confidence import log_odds, verified
from offradar_ros.retrieval.evidence import EvidenceTable


class Firsts(NamedTuple):
    """The places that come first.

    Attributes:
        columns: (Q,) int64, which of the k nearest comes first.
        log_odds: (Q,) float64 that it is right.
        right: (Q,) whether it is.
    """

    columns: NDArray[np.intp]
    log_odds: NDArray[np.float64]
    right: NDArray[np.bool_]


@dataclasses.dataclass(frozen=True, eq=False)
class AlignedPlaces:
    """The k nearest places of Q queries, nearest first.

    Attributes:
        evidence: Q · k rows, query by query: the evidence for each place, as if it were the answer.
        scores: (Q, k) float64 of the alignments, NaN for none.
        elsewhere: (Q, k) float64, those of `scores_elsewhere`.
        right: (Q, k) whether the place is within the tolerance of the query.
    """

    evidence: EvidenceTable
    scores: NDArray[np.float64]
    elsewhere: NDArray[np.float64]
    right: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.scores)

    @property
    def are_aligned(self) -> NDArray[np.bool_]:
        """(Q,) whether all places of a query are aligned with it."""
        return np.asarray(np.isfinite(self.scores).all(axis=1), np.bool_)

    def only(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> AlignedPlaces:
        """Some of the queries: a mask (Q,), or indices."""
        columns = [
            getattr(self.evidence, field.name).reshape(self.scores.shape)[rows].ravel()
            for field in dataclasses.fields(self.evidence)
        ]
        return AlignedPlaces(EvidenceTable(*columns), self.scores[rows], self.elsewhere[rows], self.right[rows])

    def by_distance(self, coefficients: ConfidenceConfig) -> NDArray[np.float64]:
        """(Q, k) float64 log-odds of each place, as if it were the answer, without alignments."""
        return log_odds(self.evidence, coefficients).reshape(self.scores.shape)

    def firsts(self, coefficients: ConfidenceConfig) -> Firsts:
        """As `verification.ranked` and `verified_log_odds` of each query.

        A query of which a place is not aligned keeps the order by distance.
        """
        order = verified(self._in_order(coefficients), self.scores, self.elsewhere, coefficients)
        columns = np.where(self.are_aligned & bool(coefficients.score), np.argmax(order, axis=1), 0)
        every = np.arange(len(self))
        odds = verified(self.by_distance(coefficients), self.scores, self.elsewhere, coefficients)
        return Firsts(columns, odds[every, columns], self.right[every, columns])

    def _in_order(self, coefficients: ConfidenceConfig) -> NDArray[np.float64]:
        """(Q, k) float64 log-odds with the distance of each place, and all other evidence of the nearest."""
        shape = self.scores.shape
        columns = [getattr(self.evidence, field.name).reshape(shape) for field in dataclasses.fields(self.evidence)[2:]]
        of_nearest = [np.repeat(column[:, :1], shape[1], axis=1).ravel() for column in columns]
        table = EvidenceTable(self.evidence.nearest, self.evidence.distance, *of_nearest)
        return log_odds(table, coefficients).reshape(shape)


def joined_places(several: Sequence[AlignedPlaces]) -> AlignedPlaces:
    """The queries of all, one after another."""
    return AlignedPlaces(
        joined_evidence([one.evidence for one in several]),
        np.concatenate([one.scores for one in several]),
        np.concatenate([one.elsewhere for one in several]),
        np.concatenate([one.right for one in several]),
    )
