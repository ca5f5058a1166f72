"""Bounds compared with slow computations, and the guarantee of the choice on simulated drives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.calibration.error_control import (
    Counts,
    counts_at,
    fewest_answers,
    interval,
    passing,
    upper_bound,
)
from offradar_ros.retrieval.thresholds import static_thresholds


def chance_of_at_most(count: int, total: int, rate: float) -> float:
    return sum(math.comb(total, k) * rate**k * (1.0 - rate) ** (total - k) for k in range(count + 1))


@pytest.mark.parametrize(('count', 'total'), [(0, 1), (0, 59), (1, 59), (3, 40), (20, 40), (39, 40)])
@pytest.mark.parametrize('confidence', [0.75, 0.95, 0.999])
def test_at_the_bound_so_low_a_count_is_as_rare_as_stated(count: int, total: int, confidence: float) -> None:
    bound = upper_bound(count, total, confidence)
    assert chance_of_at_most(count, total, bound) == pytest.approx(1.0 - confidence, abs=1e-9)


def test_without_scans_or_without_right_ones_no_share_is_excluded() -> None:
    assert upper_bound(0, 0, 0.95) == upper_bound(5, 5, 0.95) == 1.0
    assert interval(0, 0, 0.95) == (0.0, 1.0)


@pytest.mark.parametrize(('count', 'total'), [(0, 30), (3, 30), (30, 30), (17, 200)])
def test_the_interval_is_that_of_scipy(count: int, total: int) -> None:
    stats = pytest.importorskip('scipy.stats')
    known = stats.binomtest(count, total).proportion_ci(0.9, method='exact')
    assert interval(count, total, 0.9) == pytest.approx((known.low, known.high), abs=1e-9)


@pytest.mark.parametrize(('rate', 'confidence', 'expected'), [(0.05, 0.95, 59), (0.01, 0.95, 299), (0.5, 0.75, 2)])
def test_the_fewest_right_answers_are_enough_and_one_less_is_not(rate: float, confidence: float, expected: int) -> None:
    fewest = fewest_answers(rate, confidence)
    assert fewest == expected
    assert upper_bound(0, fewest, confidence) <= rate + 1e-12 < upper_bound(0, fewest - 1, confidence)


def test_counts_are_those_of_a_loop() -> None:
    rng = np.random.default_rng(3)
    uncertainties = np.round(rng.uniform(0.5, 2.0, 200), 1)
    uncertainties[:7] = np.inf
    wrong = rng.random(200) < 0.3
    thresholds = static_thresholds(1.0, 20)
    counts = counts_at(uncertainties, wrong, thresholds)
    for level, threshold in enumerate(thresholds):
        assert counts.answered[level] == sum(u <= threshold for u in uncertainties)
        assert counts.wrong[level] == sum(u <= threshold and w for u, w in zip(uncertainties, wrong, strict=True))


def passed(answered: list[int], wrong: list[int], rate: float = 0.05, confidence: float = 0.95) -> list[bool]:
    return [bool(level) for level in passing(Counts(np.array(answered), np.array(wrong)), rate, confidence)]


def test_levels_that_answer_too_few_do_not_end_the_tests() -> None:
    assert passed([0, 5, 58, 59, 70], [0, 0, 0, 0, 0]) == [False, False, False, True, True]
    assert passed([0, 5, 58], [0, 0, 0]) == [False] * 3


def test_the_first_level_that_fails_ends_them() -> None:
    assert passed([60, 70, 80, 150], [0, 0, 2, 2]) == [True, True, False, False]


def test_one_wrong_answer_among_the_first_few_does_not_end_the_tests() -> None:
    # 72 and 230 are the fewest that pass at 0.025: with none wrong, and with half of 0.05.
    assert passed([72, 229, 230, 400], [1, 1, 5, 5]) == [False, False, True, True]
    # The level of the lower start is inherited by the other: together 0.05, at which 6 of 235 pass.
    assert chance_of_at_most(6, 235, 0.05) == pytest.approx(0.049, abs=1e-3)
    assert passed([72, 235], [0, 6]) == [True, True]
    assert passed([72, 235], [1, 6]) == [False, False]


def test_where_the_tests_start_does_not_depend_on_which_answers_are_right() -> None:
    answered = [10, 80, 150, 235, 300]
    tested = [passed(answered, [0] * first + [1] * (5 - first)) for first in range(5)]
    assert tested[0] == tested[1] == [False, False, False, True, True]
    assert tested[2] == tested[3] == tested[4] == [False, True, True, True, True]


@pytest.mark.parametrize(('name', 'scans'), [('steep', 300), ('flat, just above what is wanted', 500)])
def test_the_error_rate_is_exceeded_as_rarely_as_guaranteed(name: str, scans: int) -> None:
    """Drives are drawn again and again; the chance of a wrong answer is known for each U, and so the true rate."""
    rng = np.random.default_rng(11)
    wanted, confidence, draws = 0.1, 0.8, 1500

    def chance(u: NDArray[np.float64]) -> NDArray[np.float64]:
        if name == 'steep':
            return np.clip(0.03 + 2.0 * np.maximum(u - 1.0, 0.0), 0.0, 0.9)
        return np.full(len(u), wanted + 1e-3)

    world = np.sort(rng.lognormal(0.0, 0.15, 200_000))
    true_rates = np.cumsum(chance(world)) / np.arange(1, len(world) + 1)
    broken = kept = 0
    for _ in range(draws):
        uncertainties = rng.lognormal(0.0, 0.15, scans)
        wrong = rng.random(scans) < chance(uncertainties)
        thresholds = static_thresholds(np.abs(uncertainties - 1.0).max(), 20)
        found = passing(counts_at(uncertainties, wrong, thresholds), wanted, confidence)
        if found.any():
            chosen = thresholds[np.flatnonzero(found)[-1]]
            broke = true_rates[np.searchsorted(world, chosen, side='right') - 1] > wanted
            broken, kept = broken + broke, kept + (not broke)
    # Three standard deviations of the count itself.
    allowed = (1.0 - confidence) * draws
    assert broken <= allowed + 3.0 * math.sqrt(allowed * confidence)
    if name == 'steep':
        assert kept > 0.6 * draws
    else:
        assert broken > 0.02 * draws
