from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from offradar_ros.calibration.variance_scale import largest_deviation, spanning_delta, variance_factor
from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import DataError
from offradar_ros.sequence import RadarSequence


@pytest.mark.parametrize('scale_before', [1.0, 0.3])
def test_the_factor_makes_mean_uncertainty_one(street: Callable[..., RadarSequence], scale_before: float) -> None:
    drive = street(count=4, degraded=(2,))

    def uncertainties(scale: float) -> list[float]:
        encoder = RingKeyEncoder(RingKeyConfig(variance_scale=scale))
        return [encoder.encode(drive.scan(index)).uncertainty for index in range(4)]

    values = uncertainties(scale_before * variance_factor(uncertainties(scale_before)))
    assert np.mean(values) == pytest.approx(1.0, abs=1e-6)
    assert largest_deviation(values) == pytest.approx(max(abs(value - 1.0) for value in values))
    assert largest_deviation(values) > 0.0


def test_a_run_without_scans_cannot_calibrate() -> None:
    with pytest.raises(DataError, match='calibration run: expected at least one scan'):
        variance_factor([])
    with pytest.raises(DataError, match='calibration run'):
        variance_factor([np.nan, np.inf])


def test_values_that_are_not_finite_do_not_count() -> None:
    assert variance_factor([0.5, np.nan]) == 2.0
    assert largest_deviation([0.75, np.nan, 1.125]) == 0.25
    assert largest_deviation([]) == 0.0


def test_delta_reaches_the_extremes_after_rounding() -> None:
    values = np.random.default_rng(3).uniform(0.4, 1.9, 200)
    delta = spanning_delta(values)
    assert largest_deviation(values) < delta <= largest_deviation(values) + 1.000001e-6
    assert np.float32(1.0) + np.float32(delta) >= np.float32(values.max())
