"""Introspective query rejection: the likeliest places, or a reason for the rejection (Sec. III-C, and a probability).

Where the scan can be aligned with those of the nearest places, these are ordered by both, and the score of the
alignment enters the probability.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.retrieval.confidence import (
    SimilarPlaces,
    confidence_for,
    log_odds,
    logistic,
    similar_places,
    without_rival,
)
from offradar_ros.retrieval.rival_alignments import scores_elsewhere
from offradar_ros.retrieval.searched_map import MapSearch, SearchedMap
from offradar_ros.retrieval.thresholds import threshold_at
from offradar_ros.retrieval.vehicle_pose import VehiclePose, vehicle_pose
from offradar_ros.retrieval.verification import Verifier, ranked, verified_log_odds
from offradar_ros.types import Candidate, Embedding, Evidence, Match, Outcome, Reason, Rejection


class Answer(NamedTuple):
    """The answer to one scan, and its evidence for a belief over many.

    Attributes:
        outcome: the answer.
        similar: the places found; None without a map or coefficients.
        pose: of the vehicle, if it is at the place found; None without `similar`, an alignment with a score of at least
            `query.min_pose_score`, or a heading of the place.
    """

    outcome: Outcome
    similar: SimilarPlaces | None = None
    pose: VehiclePose | None = None


class IntrospectiveQuery:
    """Answers each embedding with a match or a rejection, from one map and with one threshold on U.

    Without a `verifier`, or with `query.verify` off, no place is aligned, and the nearest is the first.
    """

    def __init__(self, config: QueryConfig, searched: SearchedMap, verifier: Verifier | None = None) -> None:
        self.config = config
        self.map = searched
        self.verifier = verifier
        # T = {(1 − Δ) + n·2Δ/N | n ∈ [0, N]}: the threshold of level n.
        self.threshold = threshold_at(config)

    def query(self, embedding: Embedding) -> Outcome:
        """A match with the `top_k` likeliest places, or a rejection with the places that a match would have had.

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
        candidates = search.nearest(max(self.config.top_k, self._verified))
        if not candidates:
            return Answer(self._rejection(embedding, Reason.MAP_EMPTY, 'the map holds no places to search'))
        evidence = search.evidence(candidates[0], self.config.tolerance_m)
        aligned = self._aligned(embedding, search, candidates)
        coefficients = confidence_for(embedding.model, self.config.confidence)
        if coefficients is None:
            aligned = aligned[: self.config.top_k]
            return Answer(self._decided(embedding, aligned, evidence, math.nan, self._paper_rule(evidence)))
        return self._judged(embedding, search, aligned, evidence, coefficients)

    def _judged(
        self,
        embedding: Embedding,
        search: MapSearch,
        candidates: tuple[Candidate, ...],
        evidence: Evidence,
        coefficients: ConfidenceConfig,
    ) -> Answer:
        """The answer with the probability that it is right; `evidence` is for the first candidate, the nearest."""
        by_probability, tolerance_m = self.config.gate == 'probability', self.config.tolerance_m
        nearest = candidates[0]
        if by_probability:
            candidates = ranked(candidates, evidence, coefficients)
        if candidates[0] is not nearest:
            evidence = search.evidence(candidates[0], tolerance_m)
        first = candidates[0]
        odds = verified_log_odds(evidence, candidates, coefficients)
        p_right = float(logistic(odds))
        if by_probability:
            rejected = self._improbable(evidence, candidates, p_right, coefficients)
        else:
            rejected = self._paper_rule(evidence)
        similar = similar_places(*search.near(first, tolerance_m), evidence, coefficients)
        # What the alignment tells is told of the place and those around it, also of one that is nearer by distance: the
        # answer as a whole is as likely as it is.
        similar = similar._replace(log_odds=similar.log_odds + (odds - float(similar.log_odds.max())))
        returned = candidates[: self.config.top_k]
        pose = vehicle_pose(first, self.config)
        outcome = self._decided(embedding, returned, evidence, p_right, rejected)
        return Answer(outcome, similar, pose if pose.has_heading else None)

    @property
    def _verified(self) -> int:
        """Number of places that a scan is aligned with."""
        return self.config.verify_candidates if self.config.verify and self.verifier is not None else 0

    def _aligned(
        self, embedding: Embedding, search: MapSearch, candidates: tuple[Candidate, ...]
    ) -> tuple[Candidate, ...]:
        """The candidates, with the alignments that can be made."""
        if self.verifier is None or not self._verified:
            return candidates
        scans = [search.scan_of(candidate) for candidate in candidates[: self._verified]]
        found = self.verifier.align(embedding.signature, scans)
        first = [dataclasses.replace(c, alignment=found.get(s)) for c, s in zip(candidates, scans, strict=False)]
        return (*first, *candidates[len(first) :])

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
        self, evidence: Evidence, candidates: Sequence[Candidate], p_right: float, coefficients: ConfidenceConfig
    ) -> tuple[Reason, str] | None:
        """Why the gate on the probability rejects, or None.

        The reason is the first that applies: a scan of high U, by the paper's rule; an alignment without which the
        answer would be probable enough; another place that resembles the scan, without which it would be; or that it
        resembles no place.
        """
        least = self._least_probability(candidates[0])
        if p_right >= least:
            return None
        low = f'right with probability {p_right:.3g}, below {least:g}'
        if evidence.uncertainty > self.threshold:
            return Reason.UNCERTAIN, f'{low}: U {evidence.uncertainty:.4g} is above {self.threshold:.4g}'
        if (aligned := candidates[0].alignment) and logistic(log_odds(evidence, coefficients)) >= least:
            score = aligned.score
            if logistic(verified_log_odds(evidence, candidates[:1], coefficients)) >= least:
                elsewhere = f'score {scores_elsewhere(candidates)[0]:.3g}, here {score:.3g}'
                return Reason.AMBIGUOUS, f'{low}: the scan agrees nearly as well with another place ({elsewhere})'
            return Reason.UNVERIFIED, f'{low}: the scan does not agree with that of the place (score {score:.3g})'
        if logistic(verified_log_odds(without_rival(evidence), candidates, coefficients)) >= least:
            rival = f'at {evidence.distance_apart:.4g}, elsewhere, after the nearest at {evidence.distance:.4g}'
            return Reason.AMBIGUOUS, f'{low}: another place resembles the scan nearly as well ({rival})'
        return Reason.UNKNOWN_PLACE, f'{low}: the scan resembles no place (the nearest is at {evidence.distance:.4g})'

    def _least_probability(self, first: Candidate) -> float:
        if first.alignment:
            return self.config.min_probability
        return max(self.config.min_probability, self.config.min_probability_unaligned)

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
