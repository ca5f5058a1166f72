"""Deviations of a radar during a drive."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.drift import NO_DEVIATION, Drift
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS
from offradar_ros.lab.simulation.radar_model import RadarModel
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan

STEADY = dataclasses.replace(NOMINAL_PHYSICS, gain_drift_db=0.0, noise_drift_db=0.0, sector_gain_db=0.0)
DRIFTING = dataclasses.replace(NOMINAL_PHYSICS, gain_drift_db=1.5, noise_drift_db=0.7, sector_gain_db=2.0)


def test_a_steady_radar_does_not_deviate() -> None:
    for seconds in (0.0, 17.0, 3000.0):
        gain_db, noise_db, sectors = Drift(STEADY, 400, 3).at(seconds)
        assert (gain_db, noise_db) == (0.0, 0.0)
        assert np.all(sectors == 1.0)


def test_gain_and_noise_wander_slowly_with_their_standard_deviations() -> None:
    """Over many drives; from scan to scan, a quarter of a second, hardly anything changes."""
    seconds = np.arange(0.0, 3000.0, 5.0)
    found = np.array([[Drift(DRIFTING, 4, seed).at(s)[:2] for s in seconds] for seed in range(10)])
    assert found.reshape(-1, 2).std(axis=0) == pytest.approx((1.5, 0.7), rel=0.1)
    assert found.reshape(-1, 2).mean(axis=0) == pytest.approx((0.0, 0.0), abs=0.1)
    drift = Drift(DRIFTING, 4, 1)
    steps = [abs(drift.at(s + 0.25).gain_db - drift.at(s).gain_db) for s in seconds]
    assert 0.0 < max(steps) < 0.1


def test_sectors_are_smooth_around_the_vehicle_and_do_not_change_during_a_drive() -> None:
    drift = Drift(DRIFTING, 400, 5)
    sectors_db = 10.0 * np.log10(drift.at(0.0).sectors[:, 0])
    assert np.array_equal(drift.at(0.0).sectors, drift.at(99.0).sectors)
    assert sectors_db.std() == pytest.approx(2.0, rel=1e-3)
    assert np.abs(sectors_db - np.roll(sectors_db, 1)).max() < 0.25
    assert not np.array_equal(drift.at(0.0).sectors, Drift(DRIFTING, 400, 6).at(0.0).sectors)


def test_a_gain_adds_to_bytes_and_noise_raises_only_what_is_weak() -> None:
    """A byte is half a decibel: 3 dB of gain are 6 more; 6 dB of noise leave strong returns as they are."""
    sensor = SimulatedSensor(azimuths=90, range_bins=300, range_resolution_m=0.2)
    physics = dataclasses.replace(
        STEADY, integer_powers=False, ground_db=-40.0, gain_db=30.0, knee=240.0, ceiling=250.0
    )
    points = np.array([(30.0, 0.0)])
    near = Reflectors(np.empty((0, 2, 2)), np.empty(0), np.empty(0), points, np.array([1e7]))

    def scan(gain_db: float, noise_db: float) -> np.ndarray:
        deviation = NO_DEVIATION._replace(gain_db=gain_db, noise_db=noise_db)
        model = RadarModel(sensor, physics)
        return model.render(near, np.zeros((90, 3)), np.random.default_rng(0), deviation=deviation).astype(float)

    plain, louder, noisier = scan(0.0, 0.0), scan(3.0, 0.0), scan(0.0, 6.0)
    strong = plain > np.quantile(plain, 0.9995)
    assert (louder - plain)[strong].mean() == pytest.approx(6.0, abs=0.5)
    assert (noisier - plain)[strong].mean() == pytest.approx(0.0, abs=0.7)
    assert (noisier - plain)[45, 200:].mean() == pytest.approx(12.0, abs=2.0)


def test_the_scans_of_a_drive_deviate() -> None:
    world = make_city(CityPlan(seed=1, blocks=(1, 1)))
    sensor = SimulatedSensor(azimuths=60, range_bins=100, range_resolution_m=0.5)
    drives = [
        SimulatedSequence(world, SessionPlan(seed=1, scans=3, physics=physics), sensor)
        for physics in (STEADY, dataclasses.replace(STEADY, gain_drift_db=6.0))
    ]
    assert not np.array_equal(drives[0].scan(1).power, drives[1].scan(1).power)
