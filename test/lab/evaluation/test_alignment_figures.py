"""Figures of aligned answers against loops over their queries."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.config import ConfidenceConfig
from offradar_ros.lab.evaluation.aligned import AlignedAnswers
from offradar_ros.lab.evaluation.alignment_figures import alignment_figures, answer_figures, first_places, pose_figures
from offradar_ros.retrieval.evidence import EvidenceTable

QUERIES, PLACES, TOLERANCE_M = 300, 3, 25.0
COEFFICIENTS = ConfidenceConfig(
    model='m',
    intercept=2.0,
    distance=-1.0,
    verified_intercept=-3.0,
    verified_log_odds=0.5,
    score=8.0,
    score_elsewhere=-4.0,
)
RANGES_M = ((0, 2), (2, 5), (5, 10), (10, 15), (15, 25))


@pytest.fixture(scope='module')
def answers() -> AlignedAnswers:
    """Places in all directions, some of them wrong or without an alignment, that are nearer where they are right."""
    rng = np.random.default_rng(3)
    shape = QUERIES, PLACES
    away_m = rng.uniform(0.0, 25.0, shape) + 40.0 * (rng.random(shape) < 0.3)
    bearings_rad = rng.uniform(-np.pi, np.pi, shape)
    turned_rad = rng.choice([0.1, -0.2, 2.9], shape)
    truths = np.stack([away_m * np.cos(bearings_rad), away_m * np.sin(bearings_rad), turned_rad], axis=-1)
    right = away_m <= TOLERANCE_M
    sigmas = np.where(right, 0.2, 5.0)[..., None] * np.array([1.0, 1.0, 0.05])
    covariances = np.einsum('qki,ij->qkij', sigmas**2, np.eye(3))
    errors = rng.normal(0.0, 1.0, (*shape, 3)) * sigmas
    scores = np.where(right, rng.normal(0.6, 0.15, shape), rng.normal(0.3, 0.15, shape))
    elsewhere = rng.uniform(0.0, 0.4, shape)
    scores[:7], errors[:7], covariances[:7] = np.nan, np.nan, np.nan
    distances = np.sort(np.where(right, rng.gamma(4.0, 0.3, shape), rng.gamma(6.0, 0.4, shape)), axis=1).ravel()
    apart = np.full(QUERIES * PLACES, 3.0)
    ones = np.ones(QUERIES * PLACES)
    in_ten = right.any(axis=1) | (rng.random(QUERIES) < 0.3)
    return AlignedAnswers(
        evidence=EvidenceTable(np.zeros(QUERIES * PLACES, np.int64), distances, apart, apart, ones, ones),
        scores=scores,
        elsewhere=elsewhere,
        errors=errors,
        covariances=covariances,
        truths=truths,
        away_m=away_m,
        on_map=in_ten | (rng.random(QUERIES) < 0.5),
        in_ten=in_ten,
        kinds=rng.choice(['', '', 'blocked', 'flooded'], QUERIES),
        query_rows=np.arange(QUERIES),
        place_rows=np.zeros(shape, np.int64),
    )


def odds_of(answers: AlignedAnswers, query: int, place: int) -> tuple[float, float]:
    """Log-odds by distance, which are all that these coefficients use, and with the score."""
    odds = 2.0 - float(answers.evidence.distance.reshape(QUERIES, PLACES)[query, place])
    score = float(answers.scores[query, place])
    elsewhere = float(answers.elsewhere[query, place])
    return odds, odds if math.isnan(score) else -3.0 + 0.5 * odds + 8.0 * score - 4.0 * elsewhere


def test_answers_against_a_loop(answers: AlignedAnswers) -> None:
    figures = answer_figures(answers, COEFFICIENTS, TOLERANCE_M)
    plain: list[tuple[float, bool]] = []
    aligned: list[tuple[float, bool]] = []
    scored: list[tuple[float, bool]] = []
    any_right = []
    for query in range(QUERIES):
        right = [bool(metres <= TOLERANCE_M) for metres in answers.away_m[query]]
        odds = [odds_of(answers, query, place) for place in range(PLACES)]
        best = max(range(PLACES), key=lambda place: odds[place][1])
        plain.append((odds[0][0], right[0]))
        aligned.append((odds[best][1], right[best]))
        if not math.isnan(answers.scores[query, best]):
            scored.append((float(answers.scores[query, best]), right[best]))
        any_right.append(any(right))
    on_map = [query for query in range(QUERIES) if answers.on_map[query]]
    assert (figures.queries, figures.on_map, figures.places) == (QUERIES, len(on_map), PLACES)
    assert figures.recall_at_1_by_distance == pytest.approx(np.mean([plain[q][1] for q in on_map]))
    assert figures.recall_at_1_aligned == pytest.approx(np.mean([aligned[q][1] for q in on_map]))
    assert figures.recall_at_k == pytest.approx(np.mean([any_right[q] for q in on_map]))
    assert figures.recall_at_10 == pytest.approx(np.mean([answers.in_ten[q] for q in on_map]))
    # The data has something to find: an order that knows the scores is better.
    assert figures.recall_at_1_by_distance < figures.recall_at_1_aligned < figures.recall_at_k < figures.recall_at_10
    won = sum(aligned[q][1] - plain[q][1] for q in on_map)
    assert figures.closed == pytest.approx(won / sum(bool(answers.in_ten[q]) - plain[q][1] for q in on_map))
    for found, several in (
        (figures.auroc_p_by_distance, plain),
        (figures.auroc_p_aligned, aligned),
        (figures.auroc_score, scored),
    ):
        assert found == pytest.approx(auroc(several))
    assert [at.precision for at in figures.at_precision] == [0.99, 0.999]
    for at in figures.at_precision:
        for share, several in ((at.by_distance, plain), (at.aligned, aligned)):
            assert share == pytest.approx(recall_at(several, at.precision) / len(on_map))


def test_first_places_are_those_of_the_figures(answers: AlignedAnswers) -> None:
    before, after = first_places(answers, COEFFICIENTS, TOLERANCE_M)
    for query in range(QUERIES):
        odds = [odds_of(answers, query, place) for place in range(PLACES)]
        best = max(range(PLACES), key=lambda place: odds[place][1])
        for found, place, expected in ((before, 0, odds[0][0]), (after, best, odds[best][1])):
            assert found.log_odds[query] == pytest.approx(expected)
            assert found.right[query] == (answers.away_m[query, place] <= TOLERANCE_M)
            assert found.scores[query] == pytest.approx(answers.scores[query, place], nan_ok=True)


def auroc(several: list[tuple[float, bool]]) -> float:
    wins = [
        1.0 if one > other else 0.5 if one == other else 0.0
        for one, right in several
        if right
        for other, wrong in several
        if not wrong
    ]
    return float(np.mean(wins))


def recall_at(several: list[tuple[float, bool]], precision: float) -> int:
    """Most right answers above any threshold with this precision."""
    most = 0
    for threshold, _ in several:
        given = [right for confidence, right in several if confidence >= threshold]
        if np.mean(given) >= precision:
            most = max(most, sum(given))
    return most


def test_poses_against_a_loop(answers: AlignedAnswers) -> None:
    figures = alignment_figures(answers, None, TOLERANCE_M)
    parts: dict[str, list[tuple[int, int]]] = {}
    for query in range(QUERIES):
        for place in range(PLACES):
            metres, (_, left_m, turned_rad) = answers.away_m[query, place], answers.truths[query, place].tolist()
            if math.isnan(answers.scores[query, place]):
                continue
            other_way, kind = abs(turned_rad) > math.radians(120.0), str(answers.kinds[query])
            ending = ', the other way' if other_way else ''
            named = [f'{low} to {high} m{ending}' for low, high in RANGES_M if low <= metres < high and not kind]
            if metres <= 10.0:
                lane = 'same way, other lane' if abs(left_m) > 2.0 else 'same way, same lane'
                named.append(kind or ('the other way' if other_way else lane))
            for name in named:
                parts.setdefault(name, []).append((query, place))
    found = figures.by_distance | figures.by_way | figures.by_fault
    assert set(found) == set(parts)
    assert {'0 to 2 m', '5 to 10 m, the other way', 'same way, other lane', 'the other way', 'flooded'} <= set(found)
    for name, pairs in parts.items():
        at = tuple(np.array(pairs).T)
        assert found[name].pairs == len(pairs)
        check_poses(answers.errors[at], answers.covariances[at])


def check_poses(errors: NDArray[np.float64], covariances: NDArray[np.float64]) -> None:
    figures = pose_figures(errors, covariances)
    off = [(math.hypot(x_m, y_m), math.degrees(abs(yaw_rad))) for x_m, y_m, yaw_rad in errors.tolist()]
    right = [n for n, (metres, degrees) in enumerate(off) if metres <= 2.0 and degrees <= 2.0]
    assert figures.pairs == len(off)
    assert figures.right == pytest.approx(len(right) / len(off))
    assert figures.within_half == pytest.approx(np.mean([metres <= 0.5 and degrees <= 0.5 for metres, degrees in off]))
    for k, (median, quantile) in enumerate(
        ((figures.median_m, figures.quantile_90_m), (figures.median_deg, figures.quantile_90_deg))
    ):
        assert median == pytest.approx(np.median([one[k] for one in off]))
        assert quantile == pytest.approx(np.quantile([one[k] for one in off], 0.9))
    squares = [float(errors[n] @ np.linalg.solve(covariances[n], errors[n])) for n in right]
    if right:
        assert figures.nees == pytest.approx(np.mean(squares) / 3.0)
        assert figures.in_ellipsoid == pytest.approx(np.mean([square <= 7.8147279 for square in squares]))
    else:
        assert math.isnan(figures.nees)


def test_true_covariances_have_nees_of_one() -> None:
    rng = np.random.default_rng(8)
    factor = np.array([[0.2, 0.0, 0.0], [0.1, 0.1, 0.0], [0.001, 0.002, 0.003]])
    errors = rng.normal(size=(20_000, 3)) @ factor.T
    covariances = np.broadcast_to(factor @ factor.T, (len(errors), 3, 3))
    figures = pose_figures(errors, covariances)
    assert figures.right == 1.0
    assert figures.nees == pytest.approx(1.0, abs=0.02)
    assert figures.in_ellipsoid == pytest.approx(0.95, abs=0.006)
    # Errors of twice the size are four times as far out.
    assert pose_figures(2.0 * errors, covariances).nees == pytest.approx(4.0, abs=0.08)


def test_answers_need_coefficients_of_the_score(answers: AlignedAnswers) -> None:
    without = dataclasses.replace(COEFFICIENTS, score=0.0)
    for coefficients in (None, without):
        assert alignment_figures(answers, coefficients, TOLERANCE_M).answers is None
    assert alignment_figures(answers, COEFFICIENTS, TOLERANCE_M).answers is not None


def test_poses_of_unknown_headings_are_left_out(answers: AlignedAnswers) -> None:
    """Recordings without headings: the answers have figures nevertheless."""
    unknown = np.full_like(answers.errors, np.nan)
    blind = dataclasses.replace(answers, errors=unknown, truths=unknown)
    figures = alignment_figures(blind, COEFFICIENTS, TOLERANCE_M)
    assert (figures.by_distance, figures.by_way, figures.by_fault) == ({}, {}, {})
    assert repr(figures.answers) == repr(answer_figures(answers, COEFFICIENTS, TOLERANCE_M))


def test_nothing_is_closed_where_every_nearest_place_is_right(answers: AlignedAnswers) -> None:
    near = dataclasses.replace(answers, away_m=np.minimum(answers.away_m, TOLERANCE_M), in_ten=answers.on_map)
    figures = answer_figures(dataclasses.replace(near, on_map=np.ones(QUERIES, np.bool_)), COEFFICIENTS, TOLERANCE_M)
    assert figures.recall_at_1_by_distance == 1.0
    assert math.isnan(figures.closed)


def test_queries_off_the_map_have_no_recall(answers: AlignedAnswers) -> None:
    off = dataclasses.replace(answers, on_map=np.zeros(QUERIES, np.bool_), away_m=answers.away_m + 100.0)
    figures = answer_figures(off, COEFFICIENTS, TOLERANCE_M)
    assert figures.on_map == 0
    assert math.isnan(figures.recall_at_1_aligned)
    assert math.isnan(figures.recall_at_k)
    assert math.isnan(figures.recall_at_10)
    assert math.isnan(figures.closed)
    assert math.isnan(figures.at_precision[0].aligned)
    assert math.isnan(figures.auroc_score)
