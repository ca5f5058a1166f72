from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.calibration import largest_deviation, variance_factor
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import DataError
from offradar_ros.types import PolarScan


@pytest.fixture
def run(street: PolarScan) -> list[PolarScan]:
    rng = np.random.default_rng(0)
    scans = []
    for level in (0, 3, 8, 20):
        noise = rng.integers(0, level + 1, street.power.shape, dtype=np.uint8)
        scans.append(dataclasses.replace(street, power=np.minimum(street.power, 200) + noise))
    return scans


@pytest.mark.parametrize('scale_before', [1.0, 0.3])
def test_the_factor_makes_mean_uncertainty_one(run: list[PolarScan], scale_before: float) -> None:
    def uncertainties(scale: float) -> list[float]:
        encoder = RingKeyEncoder(RingKeyConfig(variance_scale=scale))
        return [encoder.encode(scan).uncertainty for scan in run]

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
