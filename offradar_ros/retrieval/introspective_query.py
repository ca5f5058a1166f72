"""Introspective query rejection (Sec. III-C of the paper): the nearest places, or the reason why not."""

from __future__ import annotations

import math

from offradar_ros.config import QueryConfig
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.thresholds import threshold_at
from offradar_ros.types import Candidate, Embedding, Match, Outcome, Reason, Rejection


class IntrospectiveQuery:
    """Answers every embedding, with a match or with a reasoned rejection, from one map and with one threshold."""

    def __init__(self, config: QueryConfig, searched: SearchedMap) -> None:
        self.config = config
        self.map = searched
        # T = {(1 − Δ) + n·2Δ/N | n ∈ [0, N]}: the threshold of level n.
        self.threshold = threshold_at(config)

    def query(self, embedding: Embedding) -> Outcome:
        """The `top_k` nearest places, or a rejection with those that would have been returned where there are any.

        The first reason that holds counts. An embedding of another model is rejected as `wrong_model`: of another than
        the thresholds were calibrated with, where `query.model` says so, because they mean nothing for its U; or of
        another than the map's, where it has one. An empty map has one when it is read from a file, and none when it
        comes as a message: then any model may still fill it, and every other valid embedding is rejected as
        `map_empty`.
        """
        if problem := embedding_problem(embedding):
            return self._rejection(embedding, Reason.INVALID_EMBEDDING, problem)
        if problem := self._model_problem(embedding):
            return self._rejection(embedding, Reason.WRONG_MODEL, problem)
        # Euclidean distance is the measure of similarity; the k most similar places are the prediction.
        with_running = not self.config.exclude_current_session
        candidates = self.map.nearest(embedding, self.config.top_k, with_running=with_running)
        if not candidates:
            return self._rejection(embedding, Reason.MAP_EMPTY, 'the map holds no places to search')
        # U = (1/d) Σ_i Σ_ii: a scan of higher variance than the threshold is rejected.
        if embedding.uncertainty > self.threshold:
            detail = f'U {embedding.uncertainty:.4g} is above the threshold {self.threshold:.4g}'
            return self._rejection(embedding, Reason.UNCERTAIN, detail, candidates)
        # Not in the paper: a scan that resembles no place at all.
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
