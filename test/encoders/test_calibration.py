from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.calibration import (
    calibrate_variance_scale,
    largest_deviation,
    run_uncertainties,
    variance_factor,
)
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
    factor = calibrate_variance_scale(RingKeyEncoder(RingKeyConfig(variance_scale=scale_before)), run)
    calibrated = RingKeyEncoder(RingKeyConfig(variance_scale=scale_before * factor))
    values = run_uncertainties(calibrated, run)
    assert values.mean() == pytest.approx(1.0, abs=1e-6)
    assert largest_deviation(values) == pytest.approx(max(abs(value - 1.0) for value in values))
    assert largest_deviation(values) > 0.0


def test_refused_scans_are_left_out(run: list[PolarScan]) -> None:
    dark = dataclasses.replace(run[0], power=np.zeros_like(run[0].power))
    encoder = RingKeyEncoder(RingKeyConfig())
    np.testing.assert_array_equal(run_uncertainties(encoder, [dark, *run, dark]), run_uncertainties(encoder, run))


def test_a_run_without_scans_cannot_calibrate() -> None:
    with pytest.raises(DataError, match='calibration run: expected at least one scan'):
        calibrate_variance_scale(RingKeyEncoder(RingKeyConfig()), [])
    with pytest.raises(DataError, match='calibration run'):
        variance_factor([np.nan, np.inf])


def test_values_that_are_not_finite_do_not_count() -> None:
    assert variance_factor([0.5, np.nan]) == 2.0
    assert largest_deviation([0.75, np.nan, 1.125]) == 0.25
    assert largest_deviation([]) == 0.0
