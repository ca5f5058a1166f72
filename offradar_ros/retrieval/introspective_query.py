"""Introspective query rejection (Sec. III-C of the paper): the nearest places, or a reason for the rejection."""

from __future__ import annotations

import math

from offradar_ros.config import QueryConfig
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.thresholds import threshold_at
from offradar_ros.types import Candidate, Embedding, Match, Outcome, Reason, Rejection


class IntrospectiveQuery:
    """Answers each embedding with a match or a rejection, from one map and with one threshold on U."""

    def __init__(self, config: QueryConfig, searched: SearchedMap) -> None:
        self.config = config
        self.map = searched
        # T = {(1 − Δ) + n·2Δ/N | n ∈ [0, N]}: the threshold of level n.
        self.threshold = threshold_at(config)

    def query(self, embedding: Embedding) -> Outcome:
        """A match with the `top_k` nearest places, or a rejection with the places that a match would have had.

        The first reason that applies is given. `wrong_model`: the embedding is not of the model that the thresholds
        are calibrated for (`query.model`, if set), or not of the map's model. An empty map from a file has a model. An
        empty map from a message has none: it may later hold any model, and valid embeddings are rejected as
        `map_empty`.
        """
        if problem := embedding_problem(embedding):
            return self._rejection(embedding, Reason.INVALID_EMBEDDING, problem)
        if problem := self._model_problem(embedding):
            return self._rejection(embedding, Reason.WRONG_MODEL, problem)
        # Similarity is Euclidean distance; the prediction is the k nearest places.
        include_running = not self.config.exclude_current_session
        candidates = self.map.nearest(embedding, self.config.top_k, include_running=include_running)
        if not candidates:
            return self._rejection(embedding, Reason.MAP_EMPTY, 'the map holds no places to search')
        # U = (1/d) Σ_i Σ_ii: a scan of higher variance than the threshold is rejected.
        if embedding.uncertainty > self.threshold:
            detail = f'U {embedding.uncertainty:.4g} is above the threshold {self.threshold:.4g}'
            return self._rejection(embedding, Reason.UNCERTAIN, detail, candidates)
        # Not in the paper: a scan that is far from every place in embedding space.
        if 0.0 < self.config.max_distance < candidates[0].distance:
            detail = f'the nearest place is {candidates[0].distance:.4g} away, above {self.config.max_distance:.4g}'
            return self._rejection(embedding, Reason.UNKNOWN_PLACE, detail, candidates)
        return Match(embedding.stamp_ns, embedding.uncertainty, self.threshold, candidates)

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
