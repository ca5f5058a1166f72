"""Each metric against a plain loop."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import roc_auc_score

from offradar_ros.calibration.probability_scores import brier_score, expected_calibration_error
from offradar_ros.lab.evaluation.metrics.accepted_at_precision import accepted_at_precision
from offradar_ros.lab.evaluation.metrics.auroc import auroc, auroc_of
from offradar_ros.lab.evaluation.metrics.bootstrap import bootstrap_interval
from offradar_ros.lab.evaluation.metrics.recall_at_n import recall_at_n
from offradar_ros.lab.evaluation.metrics.recall_at_rejection import rejection_curve, rejection_curve_of
from offradar_ros.lab.evaluation.metrics.risk_coverage import augrc, aurc
from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter
from offradar_ros.lab.evaluation.metrics.spearman import spearman

# Few different values, so that many are equal.
SCORES = st.lists(st.tuples(st.sampled_from([0.1, 0.2, 0.5, 0.9, math.inf]), st.booleans()), min_size=1, max_size=12)
QUICK = settings(max_examples=60, deadline=None)


def slow_spearman(first: list[float], second: list[float]) -> float:
    a, b = (
        np.array([sum(v < value for v in values) + (1 + sum(v == value for v in values)) / 2 for value in values])
        for values in (first, second)
    )
    return float(np.corrcoef(a, b)[0, 1]) if len({*a}) > 1 and len({*b}) > 1 else math.nan


def slow_auroc(scores: list[float], positive: list[bool]) -> float:
    labelled = list(zip(scores, positive, strict=True))
    pairs = [(p, n) for p, yes in labelled if yes for n, no in labelled if not no]
    return sum((p > n) + 0.5 * (p == n) for p, n in pairs) / len(pairs) if pairs else math.nan


def slow_recall_when_rejecting(uncertainties: list[float], correct: list[bool], count: int) -> float:
    """Mean recall over every order in which equally uncertain queries may be rejected."""
    recalls = []
    for order in itertools.permutations(range(len(correct))):
        if all(uncertainties[a] <= uncertainties[b] for a, b in itertools.pairwise(order)):
            kept = order[: len(order) - count]
            recalls.append(sum(correct[i] for i in kept) / len(kept))
    return sum(recalls) / len(recalls)


@QUICK
@given(SCORES)
def test_auroc_against_a_loop_over_pairs(rows: list[tuple[float, bool]]) -> None:
    scores, positive = [s for s, _ in rows], [p for _, p in rows]
    np.testing.assert_allclose(auroc(scores, positive), slow_auroc(scores, positive))


@QUICK
@given(st.lists(st.tuples(st.floats(0, 1), st.booleans(), st.integers(0, 3)), min_size=1, max_size=15))
def test_a_weight_acts_as_a_number_of_copies(rows: list[tuple[float, bool, int]]) -> None:
    scores, labels, weights = (np.array(column) for column in zip(*rows, strict=True))
    many, many_labels = np.repeat(scores, weights), np.repeat(labels, weights)
    np.testing.assert_allclose(auroc_of(ScoreCounter(scores, labels).counts(weights)), auroc(many, many_labels))
    np.testing.assert_allclose(recall_at_n(~labels * 1, 1, weights), recall_at_n(~many_labels * 1, 1))
    weighted = rejection_curve_of(ScoreCounter(scores, labels).counts(weights))
    repeated = rejection_curve(many, many_labels)
    np.testing.assert_allclose(weighted.recall_at(0.3), repeated.recall_at(0.3))
    np.testing.assert_allclose(weighted.mean_recall(0.5), repeated.mean_recall(0.5))


@QUICK
@given(st.lists(st.tuples(st.sampled_from([0.1, 0.2, math.inf]), st.booleans()), min_size=1, max_size=6))
def test_recall_at_rejection_is_the_mean_over_the_orders_of_equal_queries(rows: list[tuple[float, bool]]) -> None:
    uncertainties, correct = [u for u, _ in rows], [c for _, c in rows]
    curve = rejection_curve(uncertainties, correct)
    for count in range(len(rows)):
        expected = slow_recall_when_rejecting(uncertainties, correct, count)
        assert curve.recall_at(count / len(rows)) == pytest.approx(expected)
    assert math.isnan(curve.recall_at(1.0))


def test_recall_at_rejection_by_hand() -> None:
    curve = rejection_curve([0.1, 0.2, 0.3, 0.4], [True, True, False, False])
    assert [curve.recall_at(r) for r in (0.0, 0.25, 0.5, 0.75)] == pytest.approx([1 / 2, 2 / 3, 1.0, 1.0])
    all_equal = rejection_curve(np.ones(10), np.arange(10) < 7)
    assert all_equal.recall_at(0.4) == pytest.approx(0.7)
    assert all_equal.mean_recall(1.0) == pytest.approx(0.7)
    with pytest.raises(ValueError, match='share'):
        curve.recall_at(1.1)


@pytest.mark.parametrize('up_to', [0.5, 1.0])
def test_the_area_is_that_of_many_narrow_strips(up_to: float) -> None:
    rng = np.random.default_rng(3)
    curve = rejection_curve(rng.integers(0, 30, 80), rng.random(80) < 0.6)
    shares = (np.arange(20_000) + 0.5) / 20_000 * up_to
    assert curve.mean_recall(up_to) == pytest.approx(np.mean([curve.recall_at(r) for r in shares]), abs=1e-4)


def test_metrics_without_samples_are_nan() -> None:
    empty = rejection_curve([], [])
    assert math.isnan(empty.recall_at(0.0))
    assert math.isnan(empty.mean_recall(0.5))
    assert math.isnan(recall_at_n([], 1))
    assert math.isnan(auroc([1.0, 2.0], [True, True]))
    assert math.isnan(spearman([1.0, 1.0], [1.0, 2.0]))
    assert all(map(math.isnan, bootstrap_interval([], len, resamples=5, seed=0)))
    assert math.isnan(spearman([], []))
    with pytest.raises(ValueError, match='NaN'):
        spearman([math.nan, 1.0], [1.0, 2.0])
    with pytest.raises(ValueError, match='NaN'):
        auroc([math.nan], [True])


def test_recall_at_n_counts_the_first_positive() -> None:
    assert [recall_at_n([0, 3, 1, 99], n) for n in (1, 2, 5)] == [0.25, 0.5, 0.75]
    with pytest.raises(ValueError, match='at least 1'):
        recall_at_n([0], 0)


@QUICK
@given(SCORES, st.randoms(use_true_random=False))
def test_spearman_is_the_correlation_of_mean_ranks(rows: list[tuple[float, bool]], chance: random.Random) -> None:
    first = [score for score, _ in rows]
    second = [float(label) + chance.choice([0.0, 0.25]) for _, label in rows]
    assert spearman(first, second) == pytest.approx(slow_spearman(first, second), nan_ok=True)


def test_spearman_takes_arrays_of_one_length() -> None:
    with pytest.raises(ValueError, match='one length'):
        spearman([1.0, 2.0], [1.0])


def test_spearman_of_ranks_by_hand() -> None:
    # Ranks 1, 2.5, 2.5, 4 against 4, 3, 2, 1: covariance −4.5, variances 4.5 and 5.
    assert spearman([1, 2, 2, 9], [8, 7, 6, 5]) == pytest.approx(-4.5 / math.sqrt(4.5 * 5.0))


def test_auroc_agrees_with_scikit_learn() -> None:
    rng = np.random.default_rng(2)
    scores, labels = rng.integers(0, 9, 60), rng.random(60) < 0.4
    assert auroc(scores, labels) == pytest.approx(roc_auc_score(labels, scores))


def test_the_interval_draws_whole_groups() -> None:
    groups, values = np.repeat([4, 7, 9], 10), np.repeat([0.0, 1.0, 2.0], 10)

    def mean(weights: np.ndarray) -> float:
        assert len(np.unique(weights[groups == 7])) == 1
        assert weights.sum() == 30
        return float(weights @ values / weights.sum())

    low, high = bootstrap_interval(groups, mean, resamples=400, seed=1)
    # One in 27 draws holds the first group only: the outermost 2.5 % are means of 0 and 2.
    assert (low, high) == (0.0, 2.0)
    assert bootstrap_interval(groups, mean, resamples=9, seed=1) == bootstrap_interval(
        groups, mean, resamples=9, seed=1
    )


@QUICK
@given(SCORES, st.sampled_from([0.5, 2 / 3, 0.9, 1.0]))
def test_answers_at_a_precision_against_every_threshold(rows: list[tuple[float, bool]], precision: float) -> None:
    confidences, right = [-score for score, _ in rows], [label for _, label in rows]
    most: list[bool] = [False] * len(rows)
    for threshold in filter(math.isfinite, confidences):
        accepted = [confidence >= threshold for confidence in confidences]
        found = [label for label, given in zip(right, accepted, strict=True) if given]
        if sum(found) / len(found) >= precision and sum(accepted) > sum(most):
            most = accepted
    assert accepted_at_precision(confidences, right, precision).tolist() == most


@QUICK
@given(st.lists(st.tuples(st.sampled_from([0.1, 0.2, math.inf]), st.booleans()), min_size=1, max_size=6))
def test_the_areas_under_risks_are_means_over_the_orders_of_equal_queries(rows: list[tuple[float, bool]]) -> None:
    scores, right, count = [s for s, _ in rows], [r for _, r in rows], len(rows)
    orders = [
        order
        for order in itertools.permutations(range(count))
        if all(scores[a] <= scores[b] for a, b in itertools.pairwise(order))
    ]
    # Numbers of wrong answers when the first 0, 1, … queries are answered, between which they grow evenly.
    wrong = np.mean([np.cumsum([0, *(not right[i] for i in order)]) for order in orders], axis=0)
    steps = np.linspace(0.0, count, 4000 * count + 1)[1:]
    between = np.interp(steps, np.arange(count + 1), wrong)
    confidences = [-score for score in scores]
    assert augrc(confidences, right) == pytest.approx(float(np.mean(between)) / count, abs=1e-3)
    assert aurc(confidences, right) == pytest.approx(float(np.mean(between / steps)), abs=1e-3)


def test_the_generalised_area_follows_from_auroc_and_accuracy() -> None:
    rng = np.random.default_rng(4)
    confidences, right = rng.integers(0, 20, 200), rng.random(200) < 0.7
    share = float(right.mean())
    expected = (1.0 - auroc(confidences, right)) * share * (1.0 - share) + (1.0 - share) ** 2 / 2.0
    assert augrc(confidences, right) == pytest.approx(expected)
    assert math.isnan(augrc([], []))
    assert math.isnan(aurc([], []))


@QUICK
@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), min_size=1, max_size=30))
def test_errors_of_a_probability_against_loops(rows: list[tuple[float, bool]]) -> None:
    p, right = np.array([value for value, _ in rows]), np.array([label for _, label in rows])
    bins: dict[int, list[tuple[float, bool]]] = {}
    for value, label in rows:
        bins.setdefault(min(int(value * 15), 14), []).append((value, label))
    gaps = [abs(sum(value - label for value, label in some)) for some in bins.values()]
    assert expected_calibration_error(p, right) == pytest.approx(sum(gaps) / len(rows))
    assert brier_score(p, right) == pytest.approx(sum((value - label) ** 2 for value, label in rows) / len(rows))
