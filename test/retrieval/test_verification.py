"""Scans are aligned with those of the nearest places, which orders the places and enters the probability."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from plane import make_plane
from street_sequence import StreetSequence

from offradar_ros.alignment.signature import SIGNATURE, SignatureMaker
from offradar_ros.alignment.signature_code import pack
from offradar_ros.alignment.twist import Twist
from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.errors import MapError, OffradarError, RefusedInput
from offradar_ros.retrieval.confidence import log_odds, logistic, verified
from offradar_ros.retrieval.introspective_query import Answer, IntrospectiveQuery
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.verification import PREPARED, Verifier
from offradar_ros.types import Alignment, Embedding, Match, Place, PlaceTable, Pose, Reason, Rejection, ScanKey

MODEL = 'a' * 64
COEFFICIENTS = ConfidenceConfig(
    model=MODEL,
    intercept=4.0,
    distance=-0.5,
    spatial_ratio=-2.0,
    verified_intercept=-4.0,
    verified_log_odds=0.5,
    score=10.0,
    unrelated_distance=10.0,
)
CONFIG = QueryConfig(top_k=2, verify_candidates=3, confidence=COEFFICIENTS, tolerance_m=5.0)


def place(place_id: int, distance: float, x_m: float, session: int = 1) -> Place:
    return Place(place_id, session, 100 + place_id, Pose(x_m, 0.0), 1.0, np.array([distance, 0.0], np.float32))


SEARCHED = (place(1, 1.0, 0.0), place(2, 1.1, 3.0), place(3, 3.0, 50.0), place(4, 4.0, 90.0))


class Scored(Verifier):
    """Gives alignments of these scores by place id; None for none."""

    def __init__(self, **scores: float | None) -> None:
        super().__init__()
        self.scores = {int(name.removeprefix('p')): score for name, score in scores.items()}
        self.asked: list[list[ScanKey]] = []

    def align(self, signature: bytes, scans: Sequence[ScanKey]) -> dict[ScanKey, Alignment]:
        self.asked.append(list(scans))
        found = {scan: self.scores.get(scan.stamp_ns - 100) for scan in scans} if signature else {}
        return {scan: Alignment(np.zeros(3), np.eye(3), score) for scan, score in found.items() if score is not None}


def ask(
    verifier: Verifier | None, signature: bytes = b'some', places: Sequence[Place] = SEARCHED, **changes: Any
) -> Answer:
    searched = SearchedMap()
    searched.load(PlaceTable.from_places(places, 2), MODEL)
    scan = Embedding(5, np.zeros(2, np.float32), np.ones(2, np.float32), MODEL, signature)
    return IntrospectiveQuery(dataclasses.replace(CONFIG, **changes), searched, verifier).answer(scan)


def ids(answer: Answer) -> list[int]:
    return [candidate.place_id for candidate in answer.outcome.candidates]


def test_the_place_that_agrees_comes_first() -> None:
    verifier = Scored(p1=0.2, p2=0.9, p3=0.3)
    answer = ask(verifier)
    assert isinstance(answer.outcome, Match)
    assert ids(answer) == [2, 1]
    assert [c.alignment.score for c in answer.outcome.candidates if c.alignment] == [0.9, 0.2]
    # Distances and evidence are those of the place that is first now.
    assert answer.outcome.evidence is not None
    assert answer.outcome.evidence.distance == pytest.approx(1.1)
    odds = -4.0 + 0.5 * float(log_odds(answer.outcome.evidence, COEFFICIENTS)) + 9.0
    assert answer.outcome.p_right == pytest.approx(1.0 / (1.0 + math.exp(-odds)))
    assert answer.similar is not None
    # A belief over many scans is told as much, although place 1 is nearer by distance.
    assert answer.similar.log_odds.max() == pytest.approx(odds)
    assert answer.similar.place_ids[np.argmax(answer.similar.log_odds)] == 1
    assert verifier.asked == [[ScanKey(1, 101), ScanKey(1, 102), ScanKey(1, 103)]]


def test_the_pose_of_the_vehicle_is_told_where_it_is_known() -> None:
    """All places of the map but the second have no heading."""
    turned = dataclasses.replace(SEARCHED[1], pose=Pose(3.0, 0.0, 0.0, math.pi / 2.0))
    places = (SEARCHED[0], turned, *SEARCHED[2:])
    answer = ask(Scored(p1=0.2, p2=0.9), places=places)
    assert answer.pose is not None
    assert (answer.pose.pose.x_m, answer.pose.pose.y_m) == (3.0, 0.0)
    assert answer.pose.pose.yaw_rad == pytest.approx(math.pi / 2.0)
    assert ask(Scored(p1=0.9, p2=0.2), places=places).pose is None
    assert ask(Scored(p1=0.2, p2=0.9), places=places, min_pose_score=0.95).pose is None
    assert ask(None, places=places).pose is None


def test_a_place_elsewhere_may_come_first() -> None:
    answer = ask(Scored(p1=0.1, p2=0.1, p3=0.95))
    assert ids(answer)[0] == 3
    assert answer.outcome.evidence is not None
    # The nearest place elsewhere is the one that was first.
    assert answer.outcome.evidence.distance_apart == pytest.approx(1.0)


def test_a_scan_that_agrees_with_no_place_is_unverified() -> None:
    assert isinstance(ask(None).outcome, Match)
    answer = ask(Scored(p1=0.1, p2=0.05))
    assert isinstance(answer.outcome, Rejection)
    assert answer.outcome.reason is Reason.UNVERIFIED
    assert 'score 0.1' in answer.outcome.detail
    assert ids(answer) == [1, 2]


def test_what_agrees_as_well_elsewhere_makes_an_answer_ambiguous() -> None:
    wary = dataclasses.replace(COEFFICIENTS, score_elsewhere=-8.0)
    sure, rival = ask(Scored(p1=0.8), confidence=wary), ask(Scored(p1=0.8, p3=0.75), confidence=wary)
    assert isinstance(sure.outcome, Match)
    assert isinstance(rival.outcome, Rejection)
    assert rival.outcome.p_right < sure.outcome.p_right
    assert rival.outcome.reason is Reason.AMBIGUOUS
    assert 'score 0.75, here 0.8' in rival.outcome.detail
    # Without the coefficient it is none of its business.
    assert ask(Scored(p1=0.8, p3=0.75)).outcome.p_right == sure.outcome.p_right


def test_an_answer_without_an_alignment_has_a_gate_of_its_own() -> None:
    by_itself: dict[str, Any] = {'min_probability': 0.3, 'min_probability_unaligned': 0.999}
    assert isinstance(ask(Scored(p1=0.8, p2=0.5)).outcome, Match)
    aligned = ask(Scored(p1=0.8, p2=0.5), **by_itself)
    assert isinstance(aligned.outcome, Match)
    alone = ask(Scored(), **by_itself)
    assert isinstance(alone.outcome, Rejection)
    assert 0.3 < alone.outcome.p_right < 0.999
    assert 'below 0.999' in alone.outcome.detail
    # The lower of the two is never the gate.
    assert isinstance(ask(Scored(), min_probability=0.999, min_probability_unaligned=0.3).outcome, Rejection)


@pytest.mark.parametrize(
    ('signature', 'changes'),
    [
        (b'', {}),
        (b'some', {'verify': False}),
        (b'some', {'confidence': dataclasses.replace(COEFFICIENTS, score=0.0)}),
    ],
)
def test_without_it_all_is_as_before(signature: bytes, changes: dict[str, Any]) -> None:
    before, answer = ask(None, signature, **changes), ask(Scored(p1=0.1, p2=0.9), signature, **changes)
    assert ids(answer) == ids(before) == [1, 2]
    assert answer.outcome.p_right == before.outcome.p_right
    assert answer.outcome.evidence == before.outcome.evidence
    assert before.similar is not None
    assert answer.similar is not None
    np.testing.assert_array_equal(answer.similar.log_odds, before.similar.log_odds)


@pytest.mark.parametrize('changes', [{'gate': 'paper'}, {'confidence': ConfidenceConfig(model='b' * 64)}])
def test_the_papers_rule_keeps_its_order_and_gains_poses(changes: dict[str, Any]) -> None:
    answer = ask(Scored(p1=0.1, p2=0.9), **changes)
    assert isinstance(answer.outcome, Match)
    assert ids(answer) == [1, 2]
    assert all(candidate.alignment is not None for candidate in answer.outcome.candidates)


def test_places_without_an_alignment_stay_where_they_are() -> None:
    assert ids(ask(Scored(p2=0.9, p3=0.1), top_k=4)) == [1, 2, 3, 4]
    answer = ask(Scored(p2=0.1, p3=0.95), top_k=4)
    assert ids(answer) == [1, 3, 2, 4]
    assert answer.outcome.candidates[0].alignment is None
    assert answer.outcome.p_right == ask(None).outcome.p_right


def test_more_places_are_aligned_than_returned() -> None:
    answer = ask(Scored(p1=0.1, p2=0.1, p3=0.95), top_k=1)
    assert ids(answer) == [3]


def test_the_probability_rises_with_the_score() -> None:
    odds = np.array([-2.0, 0.0, 2.0])
    low, high = (logistic(verified(odds, score, 0.0, COEFFICIENTS)) for score in (0.2, 0.8))
    assert (low < high).all()
    np.testing.assert_array_equal(verified(odds, math.nan, 0.0, COEFFICIENTS), odds)


class Signatures:
    """Signatures in memory, or an error where there are none."""

    def __init__(self, held: dict[ScanKey, bytes] | None) -> None:
        self.held = held

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        if self.held is None:
            raise MapError('town.db: is gone')
        return {scan: self.held[scan] for scan in scans if scan in self.held}


@pytest.fixture(scope='module')
def packed() -> list[bytes]:
    street, maker = StreetSequence(count=12), SignatureMaker()
    return [pack(maker(street.scan(row))) for row in range(len(street))]


def test_scans_are_aligned_with_what_the_source_has(packed: list[bytes]) -> None:
    here, ahead, gone, damaged = (ScanKey(1, stamp) for stamp in range(4))
    problems: list[OffradarError] = []
    source = Signatures({here: packed[4], ahead: packed[6], damaged: packed[0][:-1]})
    found = Verifier(source, problems.append).align(packed[4], [here, ahead, gone, damaged])
    assert set(found) == {here, ahead}
    assert found[here].score == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(found[here].pose, 0.0, atol=0.02)
    # Two scans further on, at 1.25 m a scan: the query is behind that place.
    np.testing.assert_allclose(found[ahead].pose, [-2.5, 0.0, 0.0], atol=0.3)
    assert [type(problem).__name__ for problem in problems] == ['RefusedInput']


def test_a_signature_that_was_made_otherwise_is_not_aligned(packed: list[bytes]) -> None:
    """As of a map by a later version."""
    grid = dataclasses.replace(SIGNATURE.grid, azimuths=100)
    other = pack(SignatureMaker(dataclasses.replace(SIGNATURE, grid=grid))(StreetSequence(count=1).scan(0)))
    ours, theirs = ScanKey(1, 0), ScanKey(1, 1)
    problems: list[OffradarError] = []
    source = Signatures({ours: packed[0], theirs: other})
    assert set(Verifier(source, problems.append).align(packed[0], [theirs, ours])) == {ours}
    (problem,) = problems
    assert isinstance(problem, RefusedInput)
    assert problem.cause == 'unlike_signatures'


@pytest.mark.parametrize('signature', [b'', b'nonsense'])
def test_a_scan_without_a_sound_signature_is_not_aligned(packed: list[bytes], signature: bytes) -> None:
    key = ScanKey(1, 0)
    assert Verifier(Signatures({key: packed[0]})).align(signature, [key]) == {}


def test_a_source_that_cannot_be_read_is_told_of(packed: list[bytes]) -> None:
    problems: list[OffradarError] = []
    assert Verifier(Signatures(None), problems.append).align(packed[0], [ScanKey(1, 0)]) == {}
    assert [str(problem) for problem in problems] == ['town.db: is gone']
    assert Verifier().align(packed[0], [ScanKey(1, 0)]) == {}


def test_a_scan_that_is_replaced_under_its_key_is_aligned_anew(packed: list[bytes]) -> None:
    key, source = ScanKey(1, 0), Signatures({})
    verifier = Verifier(source)
    for row in (3, 9, 3):
        source.held = {key: packed[row]}
        assert verifier.align(packed[3], [key])[key].score > 0.9 or row == 9
    for stamp in range(PREPARED + 2):
        source.held = {ScanKey(1, stamp): packed[stamp % len(packed)]}
        assert verifier.align(packed[3], [ScanKey(1, stamp)])


def test_motion_is_taken_out_where_that_of_both_scans_is_known() -> None:
    """The same road driven the other way bends scans the other way."""
    pose, twist = (1.5, 2.0, math.pi), Twist(20.0)
    plane, maker, here = make_plane(1), SignatureMaker(), ScanKey(1, 0)
    known = [dataclasses.replace(maker(plane.scan(at, twist=twist)), twist=twist) for at in ((0.0, 0.0, 0.0), pose)]

    def error_m(place: Twist | None, query: Twist | None) -> float:
        of_place, of_query = (
            pack(dataclasses.replace(one, twist=given)) for one, given in zip(known, (place, query), strict=True)
        )
        verifier = Verifier(Signatures({here: of_place}))
        # What was asked before changes nothing.
        verifier.align(pack(known[1]), [here])
        found = verifier.align(of_query, [here])[here].pose
        return float(math.hypot(found[0] - pose[0], found[1] - pose[1]))

    both, neither = error_m(twist, twist), error_m(None, None)
    assert both < 0.15
    assert neither > 3.0 * both
    assert error_m(twist, None) == error_m(None, twist) == neither
