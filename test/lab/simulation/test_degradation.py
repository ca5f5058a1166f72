"""Faults: gentle at first, worse with every step, and only where they should be."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.simulation.degradation import (
    HELD_OUT_KINDS,
    TRAINED_KINDS,
    Degradation,
    DegradationKind,
    degraded_noise,
    lost_rows,
)
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS
from offradar_ros.lab.simulation.radar_model import RadarModel
from offradar_ros.lab.simulation.reflectors import THROUGH, Reflectors
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
        np.array(walls), np.full(len(walls), 1e5), np.full(len(walls), THROUGH), points, np.full(len(points), 1e4)
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
def test_the_more_severe_the_less_is_left_of_the_clean_scan(
    kind: DegradationKind, model: RadarModel, street: Reflectors
) -> None:
    """Correlation with the clean scan of another noise, averaged over scans; near returns of the vehicle left out."""
    severities = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0)
    alike = [
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
    assert all(later < earlier + 0.005 for earlier, later in itertools.pairwise(alike)), alike
    assert alike[1] > 0.9 * alike[0], 'a severity of 0.05 is barely visible'
    assert alike[-1] < 0.72 * alike[0], 'a severity of 1 hides much'


@pytest.mark.parametrize('kind', DegradationKind)
def test_no_severity_is_no_fault(kind: DegradationKind, model: RadarModel, street: Reflectors) -> None:
    np.testing.assert_array_equal(scan(model, street, kind, 0.0), scan(model, street))


def test_a_blocked_sector_hides_its_rows_and_no_others(model: RadarModel, street: Reflectors) -> None:
    clean, bad = scan(model, street), scan(model, street, DegradationKind.BLOCKED, 0.6, azimuth=170)
    rows = (170 + np.arange(60)) % 200
    others = np.setdiff1d(np.arange(200), rows)
    np.testing.assert_array_equal(bad[others], clean[others])
    assert np.quantile(bad[rows, 20:], 0.99) < np.quantile(clean[rows, 20:], 0.99) - 15
    assert bad[rows, 13:15].mean() > 60


def test_flooding_lifts_the_noise_by_so_many_decibels(model: RadarModel) -> None:
    nothing = Reflectors(np.empty((0, 2, 2)), np.empty(0), np.empty(0), np.empty((0, 2)), np.empty(0))
    levels = [
        20 * np.log10(np.mean(10 ** (scan(model, nothing, DegradationKind.FLOODED, s)[:, 150:] / 20)))
        for s in (0.5, 1.0)
    ]
    assert levels[1] - levels[0] == pytest.approx(30.0, abs=1.0)


def test_saturated_azimuths_are_counted_by_severity(model: RadarModel, street: Reflectors) -> None:
    for severity in (0.2, 0.5, 1.0):
        bad = scan(model, street, DegradationKind.SATURATED, severity)
        clean = scan(model, street)
        lifted = np.median(bad[:, 20:], axis=1) > np.median(clean[:, 20:], axis=1) + 12
        assert np.count_nonzero(lifted) == round(100 * severity)


def test_interference_draws_stripes_that_drift_from_azimuth_to_azimuth() -> None:
    fault = Degradation(DegradationKind.INTERFERENCE, 1 / 14, 0)
    spoiled = degraded_noise(np.ones((200, 200), np.float32), fault, 0.3, np.random.default_rng(4))
    bright = spoiled > 10.0
    assert bright.any(axis=1).all() and bright.mean() < 0.15
    first, last = (np.flatnonzero(bright[row])[0] for row in (0, 40))
    assert first != last


def test_attenuation_sinks_returns_and_leaves_the_noise(model: RadarModel, street: Reflectors) -> None:
    clean, bad = scan(model, street), scan(model, street, DegradationKind.ATTENUATED, 0.5)
    assert np.quantile(clean[:, 20:], 0.99) - np.quantile(bad[:, 20:], 0.99) == pytest.approx(40.0, abs=10.0)
    assert np.quantile(bad[:, 150:], 0.2) <= np.quantile(clean[:, 150:], 0.2)


def test_lost_rows_are_empty_and_the_others_as_they_were(model: RadarModel, street: Reflectors) -> None:
    clean, bad = scan(model, street), scan(model, street, DegradationKind.PARTIAL, 0.5)
    empty = ~bad.any(axis=1)
    assert empty.sum() == 70
    np.testing.assert_array_equal(bad[~empty], clean[~empty])
    few, many = (
        set(lost_rows(400, Degradation(DegradationKind.PARTIAL, s, 0), np.random.default_rng(1))) for s in (0.2, 0.9)
    )
    assert few < many


def test_every_kind_is_trained_on_or_held_out() -> None:
    assert set(TRAINED_KINDS) | set(HELD_OUT_KINDS) == set(DegradationKind)
    assert not set(TRAINED_KINDS) & set(HELD_OUT_KINDS)
