"""Right answers against wrong ones and queries off the map: figures against loops, and the gate against the query."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from street_evaluation import COEFFICIENTS, SMALL_PROTOCOL, measure_street, street_drive

from offradar_ros.config import QueryConfig
from offradar_ros.lab.evaluation.answers import Answers, Pair, Rules, map_rows, places_of, search_drive_map
from offradar_ros.lab.evaluation.confidences import CONFIDENCES, confidences
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.gate import Gate, gate_of
from offradar_ros.lab.evaluation.left_out import stretch_m
from offradar_ros.lab.evaluation.open_set import open_sets
from offradar_ros.lab.evaluation.runner import Measured
from offradar_ros.lab.evaluation.summary import summarise
from offradar_ros.lab.evaluation.thresholds import Thresholds
from offradar_ros.retrieval.introspective_query import IntrospectiveQuery
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.types import Embedding, Match

PROTOCOL = dataclasses.replace(SMALL_PROTOCOL, leave_out='halves', map_spacings_m=(15.0,))
COUNT = 60


@pytest.fixture(scope='module')
def drives() -> list[EmbeddedDrive]:
    return [street_drive(index, COUNT) for index in range(3)]


@pytest.fixture(scope='module')
def measured(drives: list[EmbeddedDrive]) -> Measured:
    return measure_street('ours', drives, PROTOCOL)


def test_both_maps_of_a_drive_are_searched_and_count_as_one_pair(measured: Measured) -> None:
    assert len(measured.answers) == 12
    figures = summarise(measured.answers, PROTOCOL, measured.thresholds, measured.gate)
    assert (figures.pairs, figures.queries) == (6, 12 * COUNT)
    assert figures.open_set.on_map == figures.with_positive
    assert figures.open_set.on_map + figures.open_set.off_map == figures.queries
    assert 0.4 < figures.open_set.off_map / figures.queries < 0.5
    assert not measured.ablations


def test_the_queries_are_those_that_coefficients_are_fitted_to(drives: list[EmbeddedDrive], measured: Measured) -> None:
    for answers, other in zip(measured.answers, open_sets(drives, 15.0, 25.0), strict=True):
        np.testing.assert_array_equal(answers.correct, other.right)
        np.testing.assert_array_equal(answers.positive, other.on_map)
        assert answers.signals is not None
        np.testing.assert_array_equal(answers.signals.evidence.distance_apart, other.evidence.distance_apart)


def test_figures_of_a_confidence_against_a_loop(measured: Measured) -> None:
    found = summarise(measured.answers, PROTOCOL, measured.thresholds, measured.gate).open_set
    assert tuple(found.confidences) == tuple(CONFIDENCES)
    rows = [
        (float(p), bool(right), bool(on_map))
        for answers in measured.answers
        for p, right, on_map in zip(measured.gate.p_right(answers), answers.correct, answers.positive, strict=True)
    ]
    wrong, right = ([p for p, is_right, _ in rows if is_right is kind] for kind in (False, True))
    pairs = [(w < r) + 0.5 * (w == r) for w in wrong for r in right]
    assert found.confidences['p_right'].auroc.value == pytest.approx(sum(pairs) / len(pairs))
    assert found.confidences['p_right'].auroc.low < found.confidences['p_right'].auroc.high
    for at in found.confidences['p_right'].at_precision:
        enough = [
            limit
            for limit, _, _ in rows
            if np.mean([is_right for p, is_right, _ in rows if p >= limit]) >= at.precision
        ]
        limit = min(enough, default=math.inf)
        assert at.right_kept == pytest.approx(sum(r >= limit for r in right) / len(right))
        off = [p >= limit for p, _, on_map in rows if not on_map]
        assert at.off_map_answered == pytest.approx(sum(off) / len(off))
    answered = [(is_right, on_map) for p, is_right, on_map in rows if p >= 0.9]
    assert found.gate.rule == 'p_right'
    assert found.gate.answers == len(answered)
    assert found.gate.wrong == pytest.approx(np.mean([not is_right for is_right, _ in answered]))
    assert found.gate.answered_off_map == pytest.approx(sum(not on_map for _, on_map in answered) / found.off_map)
    assert found.gate.answered_on_map == pytest.approx(sum(on_map for _, on_map in answered) / found.on_map)
    assert found.brier == pytest.approx(np.mean([(p - is_right) ** 2 for p, is_right, _ in rows]))
    precisions = np.array(found.confidences['distance'].precisions)
    assert len(precisions) == 101
    assert (np.diff(precisions) <= 0.0).all()


@pytest.mark.parametrize('gate', ['probability', 'paper'])
@pytest.mark.parametrize('known', [True, False])
def test_the_gate_answers_what_the_query_node_answers(gate: str, known: bool, drives: list[EmbeddedDrive]) -> None:
    mapped, query = drives[:2]
    coefficients = dataclasses.replace(COEFFICIENTS, model='m' if known else 'another')
    config = QueryConfig(gate=gate, delta=0.2, levels=4, level=3, confidence=coefficients)
    places = SearchedMap()
    places.load(places_of(mapped, map_rows(mapped, 15.0)), 'm')
    asked = IntrospectiveQuery(config, places)
    answers = search_drive_map(Pair('ours', 'g', 'street', 0, 1, 15.0), mapped, query, Rules())
    found = gate_of(config, 'm', asked.threshold)
    expected = [
        asked.query(Embedding(row, mean, np.full(len(mean), u, np.float32), 'm'))
        for row, (mean, u) in enumerate(zip(query.means, query.uncertainties, strict=True))
    ]
    assert found.answered(answers).tolist() == [isinstance(outcome, Match) for outcome in expected]
    assert 0 < found.answered(answers).sum() < COUNT
    np.testing.assert_allclose(found.p_right(answers), [outcome.p_right for outcome in expected], rtol=1e-5)


def test_confidences_by_hand(drives: list[EmbeddedDrive]) -> None:
    mapped, query = drives[:2]
    answers = search_drive_map(Pair('ours', 'g', 'street', 0, 1, 15.0), mapped, query, Rules())
    found = confidences(answers, None)
    assert 'p_right' not in found
    rows = map_rows(mapped, 15.0)
    for scan in range(0, COUNT, 7):
        near = sorted((float(np.linalg.norm(mapped.means[row] - query.means[scan])), int(row)) for row in rows)
        elsewhere = next(
            d for d, row in near if abs(mapped.drive.driven_m[row] - mapped.drive.driven_m[near[0][1]]) > 25
        )
        assert found['distance'][scan] == pytest.approx(-near[0][0], rel=1e-5)
        assert found['pa_ratio'][scan] == pytest.approx(-near[0][0] / near[1][0], rel=1e-5)
        assert found['spatial_ratio'][scan] == pytest.approx(-near[0][0] / elsewhere, rel=1e-5)
        assert found['U'][scan] == -query.uncertainties[scan]


def refused(drive: EmbeddedDrive) -> EmbeddedDrive:
    return dataclasses.replace(drive, uncertainties=np.full(COUNT, np.inf), means=np.full_like(drive.means, np.nan))


@pytest.mark.parametrize(('of_map', 'of_query'), [(True, False), (False, True)])
def test_scans_without_an_answer_are_rejected(of_map: bool, of_query: bool, drives: list[EmbeddedDrive]) -> None:
    mapped = refused(drives[0]) if of_map else drives[0]
    query = refused(drives[1]) if of_query else drives[1]
    several = searched(mapped, query)
    figures = summarise(several, PROTOCOL, Thresholds(), Gate(COEFFICIENTS, 0.9))
    found = figures.open_set
    assert found.on_map > 0
    assert found.gate.answers == 0
    assert found.gate.answered_off_map == 0.0
    assert math.isnan(found.gate.wrong)
    assert math.isnan(found.ece)
    assert figures.recall_at_1.value == 0.0


def test_recall_is_undefined_off_the_map(drives: list[EmbeddedDrive]) -> None:
    mapped, query = drives[:2]
    away = dataclasses.replace(
        query, drive=dataclasses.replace(query.drive, poses=query.drive.poses + np.array([0.0, 999.0, 0.0]))
    )
    figures = summarise(searched(mapped, away), PROTOCOL, Thresholds(), Gate())
    assert (figures.with_positive, figures.open_set.off_map) == (0, 2 * COUNT)
    for value in (figures.recall_at_1.value, figures.every_query.recall_at_1, figures.open_set.gate.answered_on_map):
        assert math.isnan(value)
    # Without a gate every query is answered, each of them wrongly.
    assert (figures.open_set.gate.rule, figures.open_set.gate.answered_off_map) == ('none', 1.0)
    assert figures.open_set.gate.wrong == 1.0


def searched(mapped: EmbeddedDrive, query: EmbeddedDrive) -> list[Answers]:
    return [
        search_drive_map(
            Pair('ours', 'g', 'street', 0, 1, 15.0, n), mapped, query, Rules(), stretch_m(PROTOCOL, mapped.drive)
        )
        for n in (1, 2)
    ]


def test_the_place_of_a_refused_scan_is_left_out_with_its_stretch(drives: list[EmbeddedDrive]) -> None:
    mapped, query = drives[:2]
    uncertainties = mapped.uncertainties.copy()
    uncertainties[:10] = np.inf
    partly = dataclasses.replace(mapped, uncertainties=uncertainties)
    for whole, part in itertools.zip_longest(searched(mapped, query), searched(partly, query)):
        np.testing.assert_array_equal(part.positive, whole.positive)
