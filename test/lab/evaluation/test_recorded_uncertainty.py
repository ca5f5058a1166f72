"""Spoiled bytes of recorded scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.recorded import SPOILED, blocked, flooded, measure_recorded
from offradar_ros.types import PolarScan


def scan(power: np.ndarray, resolution_m: float = 0.0432) -> PolarScan:
    azimuths_rad = np.arange(len(power)) * 2.0 * np.pi / len(power)
    return PolarScan(0, power, azimuths_rad, resolution_m, 0.0)


def test_blocked_rows_keep_nothing_of_the_world() -> None:
    power = np.full((40, 100), 90, np.uint8)
    power[:, 90:] = 7
    spoiled = blocked(scan(power), np.random.default_rng(1), 0.25)
    changed = (spoiled != power).any(axis=1)
    assert changed.sum() == 10
    assert (spoiled[changed] == 7).all()
    # Neighbours, also where they go on at the first row.
    assert (changed != np.roll(changed, 1)).sum() == 2


def test_flooding_adds_power_of_the_level_told() -> None:
    power = np.full((200, 400), 10, np.uint8)
    power[3, 3] = 180
    spoiled = flooded(scan(power), np.random.default_rng(1), 20.0)
    # 5 dB and noise of 25 dB on average add up to 25.04 dB.
    assert 10.0 * np.log10(np.mean(10.0 ** (np.delete(spoiled, 3, axis=0) / 20.0))) == pytest.approx(25.04, abs=0.1)
    assert spoiled[3, 3] == 180
    assert (spoiled >= power).all()


def test_flooding_is_alike_over_what_the_receiver_resolves_and_no_further() -> None:
    spoiled = flooded(scan(np.zeros((400, 600), np.uint8)), np.random.default_rng(1), 30.0).astype(float)
    spoiled -= spoiled.mean()
    alike = [np.mean(spoiled[:, k:] * spoiled[:, : 600 - k]) / np.mean(spoiled**2) for k in (1, 4, 40)]
    assert alike[0] > 0.9
    assert 0.3 < alike[1] < 0.9
    assert abs(alike[2]) < 0.05


def test_recorded_scans_are_told_apart(real_data: Path) -> None:
    told = measure_recorded(RingKeyEncoder(RingKeyConfig()), real_data, seed=1)
    assert set(told) == {'clean', 'fog', *SPOILED}
    assert told['clean']['scans'] == 11
    assert told['fog']['scans'] == 18
    assert told['clean']['above_every_clean'] == 0.0
    for name in ('fog', 'flooded_20_db'):
        assert told[name]['mean'] > told['clean']['mean']
    assert told['flooded_20_db']['above_own'] == 1.0


def test_missing_recordings_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='oxford_tiny'):
        measure_recorded(RingKeyEncoder(RingKeyConfig()), tmp_path, seed=1)
