"""The motion of the radar from its scans: turns and steps of a made world."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from offradar_ros.radar.motion import ScanMotion
from offradar_ros.types import PolarScan

STEP_NS = 250_000_000
REFLECTORS = np.random.default_rng(3).uniform(-90.0, 90.0, (150, 2))


def scan(stamp_ns: int, x_m: float, y_m: float, heading_rad: float, rows: int = 400) -> PolarScan:
    """What a radar at x, y sees of the reflectors; azimuths are clockwise from its heading."""
    power = np.zeros((rows, 576), np.uint8)
    east, north = (REFLECTORS - (x_m, y_m)).T
    azimuths = np.mod(heading_rad - np.arctan2(north, east), 2 * np.pi)
    bins = (np.hypot(east, north) / 0.1736).astype(int)
    for row, column in zip(np.round(azimuths / (2 * np.pi) * rows).astype(int), bins, strict=True):
        if 10 < column < 566:
            power[np.ix_(np.arange(row - 1, row + 2) % rows, np.arange(column - 4, column + 5))] = 180
    return PolarScan(stamp_ns, power, np.arange(rows) / rows * 2 * np.pi, 0.1736)


@pytest.mark.parametrize('degrees', [-12.0, -2.7, 0.0, 4.5, 45.0])
def test_a_turn_on_the_spot(degrees: float) -> None:
    motion = ScanMotion()
    assert motion.add(scan(0, 0.0, 0.0, 1.0)) is None
    found = motion.add(scan(STEP_NS, 0.0, 0.0, 1.0 + math.radians(degrees)))
    assert found is not None
    assert found.stamp_ns == STEP_NS // 2
    assert found.turn_rate == pytest.approx(4.0 * math.radians(degrees), abs=math.radians(2.0))
    assert found.speed_mps < 2.0


@pytest.mark.parametrize('metres', [0.0, 1.0, 2.0])
def test_a_step_ahead(metres: float) -> None:
    motion = ScanMotion()
    motion.add(scan(0, 0.0, 0.0, 0.5))
    found = motion.add(scan(STEP_NS, metres * math.cos(0.5), metres * math.sin(0.5), 0.5))
    assert found is not None
    # Rough, as the docstring says: cells are 1.5 m, and the scan is turned by whole rows.
    assert found.speed_mps == pytest.approx(4.0 * metres, rel=0.4, abs=1.0)
    assert abs(found.turn_rate) < math.radians(8.0)


def test_the_number_of_rows_may_differ() -> None:
    motion = ScanMotion()
    motion.add(scan(0, 0.0, 0.0, 0.0, rows=400))
    found = motion.add(scan(STEP_NS, 0.0, 0.0, 0.2, rows=360))
    assert found is not None
    assert found.turn_rate == pytest.approx(0.8, abs=0.05)


@pytest.mark.parametrize('degrees', [-12.0, 4.5])
def test_the_order_of_the_rows_does_not_matter(degrees: float) -> None:
    """As those of a radar that turns the other way, whose azimuths get smaller."""
    motion = ScanMotion()
    for stamp_ns, heading_rad in ((0, 1.0), (STEP_NS, 1.0 + math.radians(degrees))):
        seen = scan(stamp_ns, 0.0, 0.0, heading_rad)
        back = dataclasses.replace(seen, power=seen.power[::-1], azimuths_rad=seen.azimuths_rad[::-1])
        found = motion.add(back)
    assert found is not None
    assert found.turn_rate == pytest.approx(4.0 * math.radians(degrees), abs=math.radians(2.0))


@pytest.mark.parametrize('step_ns', [0, -STEP_NS, 3 * 10**9])
def test_no_motion_over_gaps_and_steps_back(step_ns: int) -> None:
    motion = ScanMotion()
    motion.add(scan(10**10, 0.0, 0.0, 0.0))
    assert motion.add(scan(10**10 + step_ns, 0.0, 0.0, 0.0)) is None


def test_odd_scans_give_numbers() -> None:
    motion = ScanMotion()
    for k, (rows, bins, value) in enumerate([(400, 576, 0), (1, 1, 5), (2, 10, 255), (400, 6848, 0), (400, 20, 7)]):
        power = np.full((rows, bins), value, np.uint8)
        found = motion.add(PolarScan(k * STEP_NS, power, np.arange(rows) / rows * 2 * np.pi, 0.0432))
        assert found is None or (math.isfinite(found.turn_rate) and math.isfinite(found.speed_mps))
