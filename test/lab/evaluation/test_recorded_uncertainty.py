"""Degraded bytes of recorded scans."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.evaluation.recorded_uncertainty import (
    DEGRADED,
    RecordedScans,
    blocked,
    flooded,
    measure_recorded,
)
from offradar_ros.types import PolarScan


def scan(power: np.ndarray, resolution_m: float = 0.0432) -> PolarScan:
    azimuths_rad = np.arange(len(power)) * 2.0 * np.pi / len(power)
    return PolarScan(0, power, azimuths_rad, resolution_m, 0.0)


def test_blocked_rows_hold_noise_alone() -> None:
    power = np.full((40, 100), 90, np.uint8)
    power[:, 90:] = 7
    degraded = blocked(scan(power), np.random.default_rng(1), 0.25)
    changed = (degraded != power).any(axis=1)
    assert changed.sum() == 10
    assert (degraded[changed] == 7).all()
    # They are neighbours; the first row follows the last.
    assert (changed != np.roll(changed, 1)).sum() == 2


def test_flooding_adds_noise_of_its_level() -> None:
    power = np.full((200, 400), 10, np.uint8)
    power[3, 3] = 180
    degraded = flooded(scan(power), np.random.default_rng(1), 20.0)
    # 5 dB and noise of 25 dB on average add up to 25.04 dB.
    assert 10.0 * np.log10(np.mean(10.0 ** (np.delete(degraded, 3, axis=0) / 20.0))) == pytest.approx(25.04, abs=0.1)
    assert degraded[3, 3] == 180
    assert (degraded >= power).all()


def test_flooding_is_correlated_over_the_resolution_of_the_receiver() -> None:
    degraded = flooded(scan(np.zeros((400, 600), np.uint8)), np.random.default_rng(1), 30.0).astype(float)
    degraded -= degraded.mean()
    correlations = [np.mean(degraded[:, k:] * degraded[:, : 600 - k]) / np.mean(degraded**2) for k in (1, 4, 40)]
    assert correlations[0] > 0.9
    assert 0.3 < correlations[1] < 0.9
    assert abs(correlations[2]) < 0.05


@contextlib.contextmanager
def no_bar(_: str) -> Iterator[Callable[[int, int], None]]:
    yield lambda _done, _total: None


def test_recorded_scans_are_compared(real_data: Path) -> None:
    scans = RecordedScans(real_data / 'oxford_tiny', {'fog': real_data / 'radiate_tiny_foggy'})
    measured = measure_recorded({'ring_key': RingKeyEncoder(RingKeyConfig())}, scans, 1, no_bar)
    assert (measured.clean, measured.compared) == ('oxford_tiny', {'fog': 'radiate_tiny_foggy'})
    found = measured.methods['ring_key']
    assert list(found) == ['clean', *DEGRADED, 'fog']
    assert (found['clean'].scans, found['fog'].scans) == (11, 18)
    assert found['clean'].above_every_clean == 0.0
    for name in ('fog', 'flooded_20_db'):
        assert found[name].mean > found['clean'].mean
    assert found['flooded_20_db'].above_own == 1.0


def test_a_bag_is_measured_too(street_bag: Callable[..., Path]) -> None:
    scans = RecordedScans(street_bag('clear', count=3), {'silent': street_bag('silent', count=2, silent=True)})
    with pytest.raises(DataError, match='silent: expected recorded scans, none can be read'):
        measure_recorded({'ring_key': RingKeyEncoder(RingKeyConfig())}, scans, 1, no_bar)
    alone = RecordedScans(scans.clean)
    counts: list[tuple[int, int]] = []

    @contextlib.contextmanager
    def bar(_: str) -> Iterator[Callable[[int, int], None]]:
        yield lambda done, total: counts.append((done, total))

    found = measure_recorded({'ring_key': RingKeyEncoder(RingKeyConfig())}, alone, 1, bar).methods['ring_key']
    assert {figures.scans for figures in found.values()} == {3}
    assert counts == [(done, 18) for done in range(1, 19)]


def test_the_name_of_a_degradation_is_refused_for_a_recording(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match='blocked_25: expected another name'):
        RecordedScans(tmp_path, {'blocked_25': tmp_path})


def test_missing_recordings_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='sunny'):
        RecordedScans(tmp_path / 'sunny').open()
