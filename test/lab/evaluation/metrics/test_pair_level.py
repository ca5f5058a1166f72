"""Precision and recall of pairs against scikit-learn and loops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.lab.evaluation.metrics.pair_level import RECALLS, PairDistances, pair_curve, precisions_at
from offradar_ros.lab.evaluation.metrics.precision_recall import precision_recall

DISTANCES = st.lists(st.integers(0, 12).map(lambda value: value / 4.0), min_size=1, max_size=40)


@settings(max_examples=100, deadline=None)
@given(DISTANCES, DISTANCES)
def test_average_precision_agrees_with_scikit_learn(positive: list[float], negative: list[float]) -> None:
    metrics = pytest.importorskip('sklearn.metrics')
    labels = [True] * len(positive) + [False] * len(negative)
    expected = metrics.average_precision_score(labels, -np.array([*positive, *negative]))
    assert pair_curve(positive, negative).average_precision == pytest.approx(expected)


@settings(max_examples=100, deadline=None)
@given(DISTANCES, DISTANCES)
def test_precision_at_a_recall_is_the_highest_at_that_recall_or_more(
    positive: list[float], negative: list[float]
) -> None:
    points = []
    for threshold in sorted({*positive, *negative}):
        hits, misses = (sum(distance <= threshold for distance in part) for part in (positive, negative))
        if hits:
            points.append((hits / len(positive), hits / (hits + misses)))
    expected = [max(p for r, p in points if r >= recall - 1e-9) for recall in RECALLS]
    np.testing.assert_allclose(precisions_at(pair_curve(positive, negative), RECALLS), expected)


def test_precision_is_0_above_the_highest_recall() -> None:
    curve = precision_recall([1.0, 2.0], [True, False], relevant=4.0)
    assert precisions_at(curve, np.array([0.0, 0.25, 0.26, 1.0])).tolist() == [1.0, 1.0, 0.0, 0.0]


def test_blocks_add_up() -> None:
    rng = np.random.default_rng(2)
    distances, positive = rng.random((10, 7)), rng.random((10, 7)) < 0.3
    negative = ~positive & (rng.random((10, 7)) < 0.8)
    whole, parts = PairDistances(), PairDistances()
    whole.add(distances, positive, negative)
    for rows in (slice(0, 4), slice(4, 10)):
        parts.add(distances[rows], positive[rows], negative[rows])
    assert parts.level().average_precision == whole.level().average_precision
    expected = pair_curve(distances[positive], distances[negative]).average_precision
    assert whole.level().average_precision == pytest.approx(expected, abs=1e-6)


def test_figures_without_a_positive_pair_are_nan() -> None:
    level = PairDistances().level()
    assert np.isnan(level.average_precision)
    assert np.isnan(level.precisions).all()
