"""The bound holds where the answers of a cluster go wrong together, and that for single scans does not."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.calibration.clustered_bound import clustered_upper_bound
from offradar_ros.calibration.error_control import upper_bound


def capital(answered: np.ndarray, wrong: np.ndarray, rate: float) -> float:
    """What the bets of all stakes hold on average after the last cluster, one cluster after the other."""
    capitals = []
    for stake in np.linspace(0.0, 1.0, 33)[1:-1] / (1.0 - rate):
        money = 1.0
        for a, k in zip(answered / answered.max(), wrong / answered.max(), strict=True):
            money *= 1.0 - stake * (k - rate * a)
        capitals.append(money)
    return float(np.mean(capitals))


def test_the_bound_is_where_the_capital_is_large_enough() -> None:
    rng = np.random.default_rng(1)
    answered = rng.integers(1, 20, 80)
    wrong = rng.binomial(answered, 0.1)
    bound = clustered_upper_bound(answered, wrong, 0.95)
    assert capital(answered, wrong, bound) == pytest.approx(20.0, rel=1e-6)
    assert capital(answered, wrong, bound - 0.01) < 20.0 < capital(answered, wrong, bound + 0.01)
    assert wrong.sum() / answered.sum() < bound < 0.25


def test_more_clusters_tighten_the_bound_and_unanswered_ones_do_not() -> None:
    bounds = [clustered_upper_bound(np.full(n, 8), np.zeros(n, int), 0.95) for n in (5, 50, 500)]
    assert bounds == sorted(bounds, reverse=True)
    # Not below the bound for as many independent scans.
    assert all(bound >= upper_bound(0, n, 0.95) for bound, n in zip(bounds, (5, 50, 500), strict=True))
    silent = clustered_upper_bound(np.array([8] * 50 + [0] * 9), np.zeros(59, int), 0.95)
    assert silent == pytest.approx(bounds[1])
    assert clustered_upper_bound(np.zeros(3, int), np.zeros(3, int), 0.95) == 1.0
    assert clustered_upper_bound(np.full(20, 4), np.full(20, 4), 0.95) == pytest.approx(1.0)


def test_it_holds_where_whole_clusters_are_wrong() -> None:
    rng = np.random.default_rng(2)
    rate, confidence, draws = 0.1, 0.9, 400
    broken = broken_by_scans = 0
    for _ in range(draws):
        answered = rng.integers(4, 12, 60)
        wrong = answered * (rng.random(60) < rate)
        broken += clustered_upper_bound(answered, wrong, confidence) < rate
        broken_by_scans += upper_bound(int(wrong.sum()), int(answered.sum()), confidence) < rate
    assert broken <= (1.0 - confidence) * draws
    assert broken_by_scans > 1.5 * (1.0 - confidence) * draws
