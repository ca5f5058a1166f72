"""The receivers that the benchmark of headings makes up."""

from __future__ import annotations

import numpy as np
import pytest
from headings import NOISES, Noise, compare, noisy

from offradar_ros.geometry import Trajectory

SECOND = 10**9


def straight(count: int) -> Trajectory:
    """A drive eastwards at 8 m/s, 4 positions a second, by a sensor that is mounted 5° askew."""
    seconds = 0.25 * np.arange(count)
    positions = np.column_stack([8.0 * seconds, np.zeros(count), np.zeros(count)])
    stamps_ns = np.round(seconds * SECOND).astype(np.int64)
    return Trajectory(stamps_ns, positions, np.full(count, np.radians(5.0)), geodetic=False)


@pytest.mark.parametrize('noise', NOISES, ids=lambda noise: noise.name)
def test_noise_is_as_large_as_it_says_and_lasts_as_long(noise: Noise) -> None:
    drive = straight(40_000)
    received = noisy(drive, noise, seed=1)
    error = (received.positions - drive.positions[:: noise.every])[:, :2]
    assert len(received) == 40_000 / noise.every
    assert error.std() == pytest.approx(noise.sd_m, rel=0.15)
    if noise.sd_m:
        after = error[240:], error[:-240]
        expected = np.exp(-1.0) if noise.lasts_s == 60.0 else 0.0
        assert np.mean(after[0] * after[1]) / np.mean(error**2) == pytest.approx(expected, abs=0.15)


def test_errors_are_about_the_way_a_sensor_is_mounted() -> None:
    found = compare(straight(400), NOISES[0], seed=1)
    assert found.askew_deg == pytest.approx(-5.0)
    assert np.abs(found.errors_deg).max() < 1e-6
    assert found.moving.all()
    assert found.known_live == 1.0
    noise = compare(straight(400), NOISES[2], seed=1)
    assert 0.3 < np.median(np.abs(noise.errors_deg)) < 1.5
    assert np.mean(np.abs(noise.errors_deg) <= 2 * noise.told_deg) > 0.9
