"""Precision, recall and calibration against plain loops and scikit-learn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.metrics import average_precision_score, fbeta_score, precision_recall_curve

from offradar_ros.lab.evaluation.metrics.binned_calibration import BINS, binned_calibration
from offradar_ros.lab.evaluation.metrics.precision_recall import precision_recall, precision_recall_of
from offradar_ros.lab.evaluation.metrics.recall_at_rejection import rejection_curve
from offradar_ros.lab.evaluation.metrics.score_counts import ScoreCounter
from offradar_ros.lab.evaluation.metrics.sparsification import sparsification_area, sparsification_error

ROWS = st.lists(st.tuples(st.sampled_from([0.1, 0.2, 0.5, 0.9, math.inf]), st.booleans()), min_size=1, max_size=12)
BETAS = (0.5, 1.0, 2.0)
QUICK = settings(max_examples=60, deadline=None)


def slow_f_beta(scores: list[float], correct: list[bool], relevant: float, threshold: float, beta: float) -> float:
    accepted = [yes for score, yes in zip(scores, correct, strict=True) if score <= threshold < math.inf]
    if not sum(accepted):
        return 0.0
    precision, recall = sum(accepted) / len(accepted), sum(accepted) / relevant
    return (1 + beta**2) * precision * recall / (beta**2 * precision + recall)


@QUICK
@given(ROWS, st.integers(0, 5))
def test_every_point_against_a_loop(rows: list[tuple[float, bool]], missed: int) -> None:
    scores, correct = [s for s, _ in rows], [r for _, r in rows]
    relevant = sum(correct) + missed
    curve = precision_recall(scores, correct, relevant)
    assert curve.thresholds.tolist() == sorted({s for s in scores if s < math.inf})
    area, before = 0.0, 0.0
    for k, threshold in enumerate(curve.thresholds):
        accepted = [r for s, r in rows if s <= threshold]
        assert curve.precision[k] == pytest.approx(sum(accepted) / len(accepted))
        if relevant:
            recall = sum(accepted) / relevant
            assert curve.recall[k] == pytest.approx(recall)
            area, before = area + (recall - before) * sum(accepted) / len(accepted), recall
            for beta in BETAS:
                expected = slow_f_beta(scores, correct, relevant, threshold, beta)
                assert curve.f_beta(beta)[k] == pytest.approx(expected)
                assert curve.f_beta_at(threshold + 0.01, beta) == pytest.approx(expected)
    assert curve.average_precision == pytest.approx(area if relevant else math.nan, nan_ok=True)


@QUICK
@given(ROWS)
def test_f_1_is_bounded_by_the_harmonic_mean_of_f_half_and_f_2(rows: list[tuple[float, bool]]) -> None:
    scores, correct = [s for s, _ in rows], [r for _, r in rows]
    curve = precision_recall(scores, correct)
    half, one, two = (curve.f_beta(beta) for beta in BETAS)
    some = one > 0.0
    np.testing.assert_allclose(1.0 / one[some], (1.0 / half[some] + 1.0 / two[some]) / 2.0)
    best = [curve.max_f_beta(beta)[0] for beta in BETAS]
    if best[1] > 0.0:
        assert best[1] <= 2.0 / (1.0 / best[0] + 1.0 / best[2]) + 1e-12


def test_precision_and_recall_agree_with_scikit_learn() -> None:
    rng = np.random.default_rng(5)
    scores, correct = rng.integers(0, 12, 80) / 10.0, rng.random(80) < 0.4
    curve = precision_recall(scores, correct)
    assert curve.average_precision == pytest.approx(average_precision_score(correct, -scores))
    precision, recall, thresholds = precision_recall_curve(correct, -scores)
    np.testing.assert_allclose(curve.thresholds, -thresholds[::-1])
    np.testing.assert_allclose(curve.precision, precision[:-1][::-1])
    np.testing.assert_allclose(curve.recall, recall[:-1][::-1])
    for beta in BETAS:
        value, threshold = curve.max_f_beta(beta)
        assert value == pytest.approx(max(fbeta_score(correct, scores <= t, beta=beta) for t in curve.thresholds))
        assert value == pytest.approx(fbeta_score(correct, scores <= threshold, beta=beta))


@QUICK
@given(st.lists(st.tuples(st.sampled_from([0.1, 0.2, 0.5]), st.booleans(), st.integers(0, 3)), min_size=1, max_size=12))
def test_a_weight_acts_as_a_number_of_copies(rows: list[tuple[float, bool, int]]) -> None:
    scores, correct, weights = (np.array(column) for column in zip(*rows, strict=True))
    counts = ScoreCounter(scores, correct).counts(weights)
    weighted = precision_recall_of(counts, float(counts.positives.sum()))
    copies = precision_recall(np.repeat(scores, weights), np.repeat(correct, weights))
    np.testing.assert_allclose(weighted.average_precision, copies.average_precision)
    np.testing.assert_allclose(weighted.max_f_beta(1.0), copies.max_f_beta(1.0))


def test_figures_that_cannot_be_measured_are_nan() -> None:
    nothing = precision_recall([0.1], [False])
    assert math.isnan(nothing.average_precision)
    assert math.isnan(nothing.f_beta_at(1.0, 1.0))
    assert all(map(math.isnan, nothing.max_f_beta(1.0)))
    assert all(map(math.isnan, precision_recall([math.inf], [True]).max_f_beta(1.0)))
    assert precision_recall([math.inf], [True]).f_beta_at(9.0, 1.0) == 0.0
    assert precision_recall([0.2], [True]).f_beta_at(0.1, 1.0) == 0.0
    assert math.isnan(binned_calibration([], []).error)
    assert math.isnan(sparsification_area([], []))
    for measure in (precision_recall, binned_calibration):
        with pytest.raises(ValueError, match='NaN'):
            measure([math.nan], [True])
    with pytest.raises(ValueError, match='β above 0'):
        nothing.f_beta(0.0)


@QUICK
@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=12))
def test_no_ranking_is_better_than_the_oracle(rows: list[tuple[float, bool]]) -> None:
    uncertainties, correct = [u for u, _ in rows], [c for _, c in rows]
    assert sparsification_error(uncertainties, correct) >= -1e-9
    assert sparsification_error([not c for c in correct], correct) == pytest.approx(0.0)
    area = 1.0 - rejection_curve(uncertainties, correct).mean_recall(1.0)
    assert sparsification_area(uncertainties, correct) == pytest.approx(area)


def test_bins_expect_recall_to_fall_by_tenths() -> None:
    # 20 queries, two with the U of the middle of each bin; with two queries, recall falls by halves.
    middles = np.repeat(np.arange(BINS) + 0.5, 2)
    ends = [0.0, 10.0]
    correct = np.array([True, True] * 5 + [True, False] * 4 + [False, False])
    found = binned_calibration(np.concatenate([middles, ends]), np.concatenate([correct, [True, False]]))
    np.testing.assert_allclose(found.edges, np.arange(BINS + 1.0))
    np.testing.assert_allclose(found.recalls, [1.0] * 5 + [0.5] * 4 + [0.0])
    np.testing.assert_allclose(found.expected, [1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1])
    shares = np.array([3, 2, 2, 2, 2, 2, 2, 2, 2, 3]) / 22
    np.testing.assert_allclose(found.shares, shares)
    expected = shares @ np.abs(found.recalls - found.expected)
    assert found.error == pytest.approx(expected)


def test_a_lone_outlier_does_not_stretch_the_bins() -> None:
    rng = np.random.default_rng(6)
    values = np.append(rng.uniform(0.0, 1.0, 4999), 1000.0)
    found = binned_calibration(values, values < 2.0)
    assert 0.9 < found.edges[-1] < 1.1
    assert found.shares.sum() == pytest.approx(1.0)
    refused = binned_calibration([0.0, 1.0, math.inf], [True, False, False])
    assert refused.shares[-1] == pytest.approx(2 / 3)
    equal = binned_calibration([0.5, 0.5], [True, False])
    assert equal.shares.sum() == pytest.approx(1.0)
