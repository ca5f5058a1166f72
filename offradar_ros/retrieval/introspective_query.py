"""Introspective query rejection: the nearest places, or a reason for the rejection (Sec. III-C, and a probability)."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.retrieval.confidence import (
    SimilarPlaces,
    confidence_for,
    probability,
    similar_places,
    without_rival,
)
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.thresholds import threshold_at
from offradar_ros.types import Candidate, Embedding, Evidence, Match, Outcome, Reason, Rejection


class Answer(NamedTuple):
    """The answer to one scan, and its evidence for a belief over many; None without a map or coefficients."""

    outcome: Outcome
    similar: SimilarPlaces | None = None


class IntrospectiveQuery:
    """Answers each embedding with a match or a rejection, from one map and with one threshold on U."""

    def __init__(self, config: QueryConfig, searched: SearchedMap) -> None:
        self.config = config
        self.map = searched
        # T = {(1 − Δ) + n·2Δ/N | n ∈ [0, N]}: the threshold of level n.
        self.threshold = threshold_at(config)

    def query(self, embedding: Embedding) -> Outcome:
        """A match with the `top_k` nearest places, or a rejection with the places that a match would have had.

        The gate is `query.gate`: the probability that the first place is right, or the paper's rule on U, which is also
        used where no coefficients are known for the model.

        The first reason that applies is given. `wrong_model`: the embedding is not of the model that the thresholds
        are calibrated for (`query.model`, if set), or not of the map's model. An empty map from a file has a model. An
        empty map from a message has none: it may later hold any model, and valid embeddings are rejected as
        `map_empty`.
        """
        return self.answer(embedding).outcome

    def answer(self, embedding: Embedding) -> Answer:
        """As `query`, with the evidence for a belief over many scans."""
        if problem := embedding_problem(embedding):
            return Answer(self._rejection(embedding, Reason.INVALID_EMBEDDING, problem))
        if problem := self._model_problem(embedding):
            return Answer(self._rejection(embedding, Reason.WRONG_MODEL, problem))
        # Similarity is Euclidean distance; the prediction is the k nearest places.
        search = self.map.around(embedding, include_running=not self.config.exclude_current_session)
        candidates = search.nearest(self.config.top_k)
        if not candidates:
            return Answer(self._rejection(embedding, Reason.MAP_EMPTY, 'the map holds no places to search'))
        tolerance_m = self.config.tolerance_m
        evidence = search.evidence(candidates[0], tolerance_m)
        coefficients = confidence_for(embedding.model, self.config.confidence)
        if coefficients is None:
            return Answer(self._decided(embedding, candidates, evidence, math.nan, self._paper_rule(evidence)))
        p_right = float(probability(evidence, coefficients))
        by_probability = self.config.gate == 'probability'
        found = self._improbable(evidence, p_right, coefficients) if by_probability else self._paper_rule(evidence)
        similar = similar_places(*search.near(candidates[0], tolerance_m), evidence, coefficients)
        return Answer(self._decided(embedding, candidates, evidence, p_right, found), similar)

    def _decided(
        self,
        embedding: Embedding,
        candidates: tuple[Candidate, ...],
        evidence: Evidence,
        p_right: float,
        rejected: tuple[Reason, str] | None,
    ) -> Outcome:
        if rejected is None:
            return Match(embedding.stamp_ns, embedding.uncertainty, self.threshold, candidates, p_right, evidence)
        rejection = self._rejection(embedding, *rejected, candidates)
        return dataclasses.replace(rejection, p_right=p_right, evidence=evidence)

    def _paper_rule(self, evidence: Evidence) -> tuple[Reason, str] | None:
        """Why the paper's rule rejects, or None."""
        # U = (1/d) Σ_i Σ_ii: a scan of higher variance than the threshold is rejected.
        if evidence.uncertainty > self.threshold:
            return Reason.UNCERTAIN, f'U {evidence.uncertainty:.4g} is above the threshold {self.threshold:.4g}'
        # Not in the paper: a scan that is far from every place in embedding space.
        if 0.0 < self.config.max_distance < evidence.distance:
            return (
                Reason.UNKNOWN_PLACE,
                f'the nearest place is {evidence.distance:.4g} away, above {self.config.max_distance:.4g}',
            )
        return None

    def _improbable(
        self, evidence: Evidence, p_right: float, coefficients: ConfidenceConfig
    ) -> tuple[Reason, str] | None:
        """Why the gate on the probability rejects, or None.

        The reason is the first that applies: a scan of high U, by the paper's rule; another place that resembles it,
        without which the answer would be probable enough; or that it resembles no place.
        """
        least = self.config.min_probability
        if p_right >= least:
            return None
        low = f'right with probability {p_right:.3g}, below {least:g}'
        if evidence.uncertainty > self.threshold:
            return Reason.UNCERTAIN, f'{low}: U {evidence.uncertainty:.4g} is above {self.threshold:.4g}'
        if probability(without_rival(evidence), coefficients) >= least:
            rival = f'at {evidence.distance_apart:.4g}, elsewhere, after the nearest at {evidence.distance:.4g}'
            return Reason.AMBIGUOUS, f'{low}: another place resembles the scan nearly as well ({rival})'
        return Reason.UNKNOWN_PLACE, f'{low}: the scan resembles no place (the nearest is at {evidence.distance:.4g})'

    def _model_problem(self, embedding: Embedding) -> str | None:
        made_by = f'made by model {embedding.model[:12] or "(none)"}'
        if self.config.model and embedding.model != self.config.model:
            return f'{made_by}, the thresholds are calibrated for model {self.config.model[:12]} (query.model)'
        if not self.map.model:
            return None
        if embedding.model != self.map.model:
            return f'{made_by}, the map is of model {self.map.model[:12]}'
        if embedding.mean.size != self.map.dimension:
            return f'has dimension {embedding.mean.size}, the map has {self.map.dimension}'
        return None

    def _rejection(
        self, embedding: Embedding, reason: Reason, detail: str, candidates: tuple[Candidate, ...] = ()
    ) -> Rejection:
        uncertainty = math.nan if reason is Reason.INVALID_EMBEDDING else embedding.uncertainty
        return Rejection(embedding.stamp_ns, reason, uncertainty, self.threshold, candidates, detail)
