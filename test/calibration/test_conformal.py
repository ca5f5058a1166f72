from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.calibration.conformal import conformal_quantile, risk_bound, scans_for_quantile


def test_the_quantile_is_the_right_one_in_order() -> None:
    values = np.random.default_rng(1).permutation(np.arange(1.0, 100.0))
    # 99 scans and 0.01: the 99th of them; 0.1: the 90th.
    assert conformal_quantile(values, 0.01) == 99.0
    assert conformal_quantile(values, 0.1) == 90.0
    assert conformal_quantile(values[:50], 0.01) == values[:50].max()


@pytest.mark.parametrize(('share', 'fewest'), [(0.01, 99), (0.05, 19), (0.3, 3), (0.5, 1)])
def test_the_number_of_scans_for_a_quantile_bounds_the_share(share: float, fewest: int) -> None:
    assert scans_for_quantile(share) == fewest
    assert 1.0 / (fewest + 1) <= share + 1e-12 < 1.0 / fewest


@pytest.mark.parametrize('share', [0.05, 0.21])
def test_one_more_scan_is_above_it_as_rarely_as_guaranteed(share: float) -> None:
    rng = np.random.default_rng(2)
    drives = rng.gamma(4.0, size=(20_000, 40))
    above = np.mean([conformal_quantile(drive[:-1], share) < drive[-1] for drive in drives])
    deviation = (share * (1.0 - share) / len(drives)) ** 0.5
    assert above <= share + 3.0 * deviation
    assert above > share - 1.0 / 40 - 3.0 * deviation


def test_one_more_scan_is_answered_wrongly_as_rarely_as_guaranteed() -> None:
    """The highest threshold whose bound is at most 0.1, of every value of U."""
    rng = np.random.default_rng(3)
    wanted, scans, wrongly = 0.1, 60, 0
    for _ in range(6000):
        uncertainties = rng.random(scans + 1)
        wrong = rng.random(scans + 1) < uncertainties
        order = np.argsort(uncertainties[:-1])
        bounds = [risk_bound(int(k), scans) for k in np.cumsum(wrong[order])]
        answered = np.searchsorted(bounds, wanted, side='right')
        # Up to just below the next scan, which would be one too many.
        end = uncertainties[order[answered]] if answered < scans else np.inf
        wrongly += bool(wrong[-1] and uncertainties[-1] < end)
    assert 0.08 < wrongly / 6000 <= wanted + 3.0 * (0.09 / 6000) ** 0.5
