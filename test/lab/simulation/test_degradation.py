"""Faults: hardly visible at low severity, stronger with severity, and only where they belong."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.simulation.degradation import (
    Degradation,
    DegradationKind,
    degraded_noise,
    lost_rows,
)
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS
from offradar_ros.lab.simulation.radar_model import RadarModel
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.sensor import SimulatedSensor

SENSOR = SimulatedSensor(azimuths=200, range_bins=200, range_resolution_m=0.3)


@pytest.fixture(scope='module')
def model() -> RadarModel:
    return RadarModel(SENSOR, NOMINAL_PHYSICS)


@pytest.fixture(scope='module')
def street() -> Reflectors:
    rng = np.random.default_rng(0)
    walls = [
        ((x, side * y), (x + 9.0, side * y)) for x in np.arange(-50.0, 50.0, 11.0) for side, y in ((1, 9), (-1, 12))
    ]
    points = rng.uniform(-45.0, 45.0, (60, 2))
    return Reflectors(
        np.array(walls), np.full(len(walls), 1e5), np.full(len(walls), 1.0 / 12.0), points, np.full(len(points), 1e4)
    )


def scan(
    model: RadarModel,
    street: Reflectors,
    kind: DegradationKind | None = None,
    severity: float = 0.0,
    seed: int = 0,
    azimuth: int = 30,
) -> NDArray[np.float64]:
    fault = Degradation(kind, severity, azimuth) if kind else None
    return model.render(street, np.zeros((200, 3)), np.random.default_rng(seed), fault).astype(float)


@pytest.mark.parametrize('kind', DegradationKind)
def test_similarity_to_the_clean_scan_falls_with_severity(
    kind: DegradationKind, model: RadarModel, street: Reflectors
) -> None:
    """Mean correlation with the clean scan under other noise, without the near returns of the vehicle."""
    severities = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0)
    correlations = [
        np.mean(
            [
                np.corrcoef(
                    scan(model, street, kind, severity, seed, 37 * seed)[:, 10:].ravel(),
                    scan(model, street, seed=seed + 50)[:, 10:].ravel(),
                )[0, 1]
                for seed in range(6)
            ]
        )
        for severity in severities
    ]
    assert all(later < earlier + 0.005 for earlier, later in itertools.pairwise(correlations)), correlations
    assert correlations[1] > 0.9 * correlations[0], 'a severity of 0.05 is barely visible'
    assert correlations[-1] < 0.72 * correlations[0], 'a severity of 1 hides much'


@pytest.mark.parametrize('kind', DegradationKind)
def test_severity_zero_changes_nothing(kind: DegradationKind, model: RadarModel, street: Reflectors) -> None:
    np.testing.assert_array_equal(scan(model, street, kind, 0.0), scan(model, street))


def test_a_blocked_sector_hides_its_rows_and_no_others(model: RadarModel, street: Reflectors) -> None:
    clean, degraded = scan(model, street), scan(model, street, DegradationKind.BLOCKED, 0.6, azimuth=170)
    rows = (170 + np.arange(60)) % 200
    others = np.setdiff1d(np.arange(200), rows)
    np.testing.assert_array_equal(degraded[others], clean[others])
    assert np.quantile(degraded[rows, 20:], 0.99) < np.quantile(clean[rows, 20:], 0.99) - 15
    assert degraded[rows, 13:15].mean() > 60


def test_flooding_raises_the_noise_by_up_to_30_db(model: RadarModel) -> None:
    nothing = Reflectors(np.empty((0, 2, 2)), np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0))
    levels = [
        20 * np.log10(np.mean(10 ** (scan(model, nothing, DegradationKind.FLOODED, s)[:, 150:] / 20)))
        for s in (0.5, 1.0)
    ]
    assert levels[1] - levels[0] == pytest.approx(30.0, abs=1.0)


def test_severity_is_the_number_of_saturated_azimuths(model: RadarModel, street: Reflectors) -> None:
    for severity in (0.2, 0.5, 1.0):
        degraded = scan(model, street, DegradationKind.SATURATED, severity)
        clean = scan(model, street)
        lifted = np.median(degraded[:, 20:], axis=1) > np.median(clean[:, 20:], axis=1) + 12
        assert np.count_nonzero(lifted) == round(100 * severity)


def test_stripes_of_interference_change_range_from_azimuth_to_azimuth() -> None:
    fault = Degradation(DegradationKind.INTERFERENCE, 1 / 14, 0)
    degraded = degraded_noise(np.ones((200, 200), np.float32), fault, 0.3, np.random.default_rng(4))
    bright = degraded > 10.0
    assert bright.any(axis=1).all() and bright.mean() < 0.15
    first, last = (np.flatnonzero(bright[row])[0] for row in (0, 40))
    assert first != last


def test_attenuation_lowers_returns_and_not_the_noise(model: RadarModel, street: Reflectors) -> None:
    clean, degraded = scan(model, street), scan(model, street, DegradationKind.ATTENUATED, 0.5)
    assert np.quantile(clean[:, 20:], 0.99) - np.quantile(degraded[:, 20:], 0.99) == pytest.approx(40.0, abs=10.0)
    assert np.quantile(degraded[:, 150:], 0.2) <= np.quantile(clean[:, 150:], 0.2)


def test_lost_rows_are_empty_and_the_others_unchanged(model: RadarModel, street: Reflectors) -> None:
    clean, degraded = scan(model, street), scan(model, street, DegradationKind.PARTIAL, 0.5)
    empty = ~degraded.any(axis=1)
    assert empty.sum() == 70
    np.testing.assert_array_equal(degraded[~empty], clean[~empty])
    few, many = (
        set(lost_rows(400, Degradation(DegradationKind.PARTIAL, s, 0), np.random.default_rng(1))) for s in (0.2, 0.9)
    )
    assert few < many
