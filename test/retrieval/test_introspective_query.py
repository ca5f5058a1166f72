"""Every embedding gets one answer: a match, or the first rejection reason that applies."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.retrieval.introspective_query import IntrospectiveQuery
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.types import Embedding, Evidence, Match, Outcome, Place, PlaceTable, Pose, Reason, Rejection

MODEL, OTHER = 'a' * 64, 'b' * 64
CONFIG = QueryConfig(top_k=2, delta=0.5, levels=10, level=10)


def places(*entries: tuple[int, tuple[float, float]], session: int = 1) -> PlaceTable:
    """Places (id, mean) of dimension 2."""
    made = [Place(i, session, i, Pose(i * 1.0, 0.0), 0.9, np.asarray(mean, np.float32)) for i, mean in entries]
    return PlaceTable.from_places(made, 2)


def scan(
    mean: tuple[float, ...] = (0.0, 0.0), uncertainty: float = 1.0, model: str = MODEL, stamp: int = 5
) -> Embedding:
    return Embedding(stamp, np.asarray(mean, np.float32), np.full(len(mean), uncertainty, np.float32), model)


@pytest.fixture
def searched() -> SearchedMap:
    loaded = SearchedMap()
    loaded.load(places((1, (3, 4)), (2, (0, 1)), (3, (10, 0))), MODEL)
    return loaded


def answer(searched: SearchedMap, embedding: Embedding, **changes: Any) -> Outcome:
    return IntrospectiveQuery(dataclasses.replace(CONFIG, **changes), searched).query(embedding)


def ids(outcome: Outcome) -> list[int]:
    return [candidate.place_id for candidate in outcome.candidates]


def test_a_match_has_the_nearest_places_in_order(searched: SearchedMap) -> None:
    outcome = answer(searched, scan())
    assert isinstance(outcome, Match)
    assert ids(outcome) == [2, 1]
    assert [c.distance for c in outcome.candidates] == [1.0, 5.0]
    assert (outcome.stamp_ns, outcome.uncertainty, outcome.threshold) == (5, 1.0, 1.5)


@pytest.mark.parametrize(('uncertainty', 'accepted'), [(1.5, True), (1.5001, False), (0.0, True), (100.0, False)])
def test_a_scan_above_the_threshold_is_uncertain_and_has_candidates(
    searched: SearchedMap, uncertainty: float, accepted: bool
) -> None:
    outcome = answer(searched, scan(uncertainty=uncertainty))
    assert isinstance(outcome, Match) == accepted
    assert ids(outcome) == [2, 1]
    if isinstance(outcome, Rejection):
        assert outcome.reason is Reason.UNCERTAIN
        assert '1.5' in outcome.detail


def test_the_level_chooses_the_threshold(searched: SearchedMap) -> None:
    outcome = answer(searched, scan(uncertainty=0.6), level=0)
    assert isinstance(outcome, Rejection)
    assert outcome.threshold == 0.5
    assert ids(answer(searched, scan(uncertainty=0.55), level=1, top_k=3)) == [2, 1, 3]


def test_a_scan_far_from_every_place_is_of_an_unknown_place(searched: SearchedMap) -> None:
    far = scan((500.0, 0.0))
    assert isinstance(answer(searched, far), Match)
    outcome = answer(searched, far, max_distance=20.0)
    assert isinstance(outcome, Rejection)
    assert outcome.reason is Reason.UNKNOWN_PLACE
    assert ids(outcome) == [3, 1]
    assert '490' in outcome.detail
    assert '20' in outcome.detail
    assert isinstance(answer(searched, scan((10.0, 20.0)), max_distance=20.0), Match)


def test_places_of_the_running_session_are_found_only_if_configured(searched: SearchedMap) -> None:
    searched.update(places((7, (0.5, 0)), session=2), MODEL, committed=False)
    assert ids(answer(searched, scan(stamp=100))) == [2, 1]
    assert ids(answer(searched, scan(stamp=100), exclude_current_session=False)) == [7, 2]


@pytest.mark.parametrize(
    'embedding',
    [
        scan((math.nan, 0.0)),
        scan((0.0, math.inf)),
        scan(uncertainty=math.nan),
        scan(uncertainty=-0.5),
        scan(()),
        Embedding(5, np.zeros(2, np.float32), np.ones(3, np.float32), MODEL),
    ],
)
def test_an_invalid_embedding_has_no_uncertainty(searched: SearchedMap, embedding: Embedding) -> None:
    outcome = answer(searched, embedding)
    assert isinstance(outcome, Rejection)
    assert outcome.reason is Reason.INVALID_EMBEDDING
    assert math.isnan(outcome.uncertainty)
    assert outcome.candidates == ()
    assert outcome.stamp_ns == 5
    assert outcome.detail
    assert '\n' not in outcome.detail


def rejected(searched: SearchedMap, embedding: Embedding, **changes: Any) -> Rejection:
    outcome = answer(searched, embedding, **changes)
    assert isinstance(outcome, Rejection)
    return outcome


def test_embeddings_of_another_model_or_dimension_are_rejected(searched: SearchedMap) -> None:
    outcome = rejected(searched, scan(model=OTHER))
    assert outcome.reason is Reason.WRONG_MODEL
    assert outcome.candidates == ()
    assert 'bbbb' in outcome.detail
    assert 'aaaa' in outcome.detail
    outcome = rejected(searched, scan((0.0, 0.0, 0.0)))
    assert outcome.reason is Reason.WRONG_MODEL
    assert 'dimension 3, the map has 2' in outcome.detail


def test_thresholds_of_another_model_reject_every_embedding(searched: SearchedMap) -> None:
    assert isinstance(answer(searched, scan(), model=MODEL), Match)
    outcome = rejected(searched, scan(), model=OTHER)
    assert outcome.reason is Reason.WRONG_MODEL
    assert outcome.candidates == ()
    assert outcome.uncertainty == 1.0
    assert 'model aaaaaaaaaaaa' in outcome.detail
    assert 'calibrated for model bbbbbbbbbbbb' in outcome.detail
    assert rejected(searched, scan(model=''), model=OTHER).detail.startswith('made by model (none)')
    assert rejected(searched, scan((math.nan, 0.0)), model=OTHER).reason is Reason.INVALID_EMBEDDING
    searched.load(places(), '')
    assert rejected(searched, scan(), model=OTHER).reason is Reason.WRONG_MODEL
    assert rejected(searched, scan(model=OTHER), model=OTHER).reason is Reason.MAP_EMPTY


def test_the_first_reason_that_applies_is_given(searched: SearchedMap) -> None:
    strict: dict[str, Any] = {'level': 0, 'max_distance': 1.0}
    assert rejected(searched, scan((math.nan, 9e9), model=OTHER), **strict).reason is Reason.INVALID_EMBEDDING
    assert rejected(searched, scan((0.0, 9e9), 2.0, model=OTHER), **strict).reason is Reason.WRONG_MODEL
    assert rejected(searched, scan((0.0, 9e9), 2.0), **strict).reason is Reason.UNCERTAIN
    searched.load(places(), MODEL)
    assert rejected(searched, scan((0.0, 9e9), 2.0, model=OTHER), **strict).reason is Reason.WRONG_MODEL
    assert rejected(searched, scan((0.0, 9e9), 2.0), **strict).reason is Reason.MAP_EMPTY


def test_an_empty_map_is_searched_after_its_first_update() -> None:
    searched = SearchedMap()
    assert rejected(searched, scan()).reason is Reason.MAP_EMPTY
    # An empty map from a message has no model.
    searched.load(places(), '')
    assert rejected(searched, scan(model=OTHER)).reason is Reason.MAP_EMPTY
    searched.update(places((1, (0, 0))), MODEL, committed=True)
    assert isinstance(answer(searched, scan()), Match)


# At distance 1 from place 2; places 1 and 3 are within 25 m of it, so that nothing is elsewhere.
PROBABLE = ConfidenceConfig(model=MODEL, intercept=3.0, distance=-1.0, uncertainty=-2.0, unrelated_distance=10.0)


def p_of(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))


def test_an_answer_has_its_probability_and_evidence(searched: SearchedMap) -> None:
    outcome = answer(searched, scan(), confidence=PROBABLE, min_probability=0.5)
    assert isinstance(outcome, Match)
    assert outcome.p_right == pytest.approx(p_of(2.0))
    assert outcome.evidence == Evidence(1.0, math.inf, math.inf, 1.0, float(np.float32(0.9)))


def test_without_coefficients_the_probability_is_unknown_and_the_paper_decides(searched: SearchedMap) -> None:
    accepted, rejected = answer(searched, scan()), answer(searched, scan(uncertainty=2.0))
    assert isinstance(accepted, Match)
    assert isinstance(rejected, Rejection)
    assert rejected.reason is Reason.UNCERTAIN
    assert math.isnan(accepted.p_right)
    assert math.isnan(rejected.p_right)
    assert accepted.evidence is not None


def test_an_improbable_answer_is_withheld(searched: SearchedMap) -> None:
    outcome = answer(searched, scan((500.0, 0.0)), confidence=PROBABLE)
    assert isinstance(outcome, Rejection)
    assert outcome.reason is Reason.UNKNOWN_PLACE
    assert ids(outcome) == [3, 1]
    assert outcome.p_right < 1e-6
    assert 'resembles no place' in outcome.detail


def test_a_degraded_scan_is_uncertain_before_it_is_of_an_unknown_place(searched: SearchedMap) -> None:
    outcome = answer(searched, scan((6.0, 0.0), uncertainty=5.0), confidence=PROBABLE)
    assert isinstance(outcome, Rejection)
    assert outcome.reason is Reason.UNCERTAIN


def test_a_scan_of_high_uncertainty_is_answered_where_the_answer_is_probable(searched: SearchedMap) -> None:
    likely = dataclasses.replace(PROBABLE, intercept=20.0)
    by_probability, by_paper = (
        answer(searched, scan(uncertainty=2.0), confidence=likely, gate=gate) for gate in ('probability', 'paper')
    )
    assert isinstance(by_probability, Match)
    assert isinstance(by_paper, Rejection)
    assert by_paper.reason is Reason.UNCERTAIN
    assert by_paper.p_right == by_probability.p_right


def test_two_distant_places_that_resemble_the_scan_are_ambiguous() -> None:
    searched = SearchedMap()
    twins = places((1, (0, 1)), (200, (0, -1)))
    searched.load(twins, MODEL)
    rivals = dataclasses.replace(PROBABLE, spatial_ratio=-3.0)
    outcome = answer(searched, scan(), confidence=rivals)
    assert isinstance(outcome, Rejection)
    assert outcome.reason is Reason.AMBIGUOUS
    assert 'another place' in outcome.detail
    # The same scan where only one of them is mapped.
    searched.load(places((1, (0, 1))), MODEL)
    assert isinstance(answer(searched, scan(), confidence=rivals), Match)


def test_the_tolerance_says_which_places_are_the_same_answer() -> None:
    searched = SearchedMap()
    searched.load(places((1, (0, 1)), (41, (0, -1))), MODEL)
    rivals = dataclasses.replace(PROBABLE, spatial_ratio=-3.0)
    assert isinstance(answer(searched, scan(), confidence=rivals), Rejection)
    assert isinstance(answer(searched, scan(), confidence=rivals, tolerance_m=50.0), Match)
