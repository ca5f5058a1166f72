"""An offset between the clocks of radar and positions is found in simulated drives, and none where there is none."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from offradar_ros.geometry import Trajectory
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.route_sessions import session_plan
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.recordings.datasets.check import clocks as check_clocks
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.motion_clock import MotionOffset
from offradar_ros.types import PolarScan

SECOND = 10**9


class Seen(NamedTuple):
    """The motion of a drive's scans, and its positions."""

    clock: ScanClock
    trajectory: Trajectory


@pytest.fixture(scope='module', params=[4, 5])
def seen(request: pytest.FixtureRequest) -> Seen:
    """100 s with turns and stops."""
    plan = dataclasses.replace(session_plan(0, scans=400, seed=request.param, degraded=0.0), stops=2)
    sequence = SimulatedSequence(make_city(CityPlan(seed=request.param)), plan)
    clock = ScanClock()
    for index in range(len(sequence)):
        clock.add(sequence.scan(index))
    return Seen(clock, sequence.trajectory)


def moved(trajectory: Trajectory, seconds: float) -> Trajectory:
    return dataclasses.replace(trajectory, stamps_ns=trajectory.stamps_ns + round(seconds * SECOND))


def noisy(trajectory: Trajectory, sigma_m: float) -> Trajectory:
    """As of a cheap receiver, once a second."""
    degrees = np.random.default_rng(1).normal(0.0, sigma_m / 111_250, trajectory.positions.shape)
    degrees[:, 2] = 0.0
    some = slice(None, None, 10)
    return dataclasses.replace(
        trajectory,
        stamps_ns=trajectory.stamps_ns[some],
        positions=(trajectory.positions + degrees)[some],
        yaws_rad=np.full(len(trajectory.stamps_ns[some]), np.nan),
    )


@pytest.mark.parametrize('offset_s', [37.0, -37.0, -18.0, 2.5])
def test_an_offset_is_found_with_the_option_that_corrects_it(seen: Seen, offset_s: float) -> None:
    text = seen.clock.problem(moved(seen.trajectory, offset_s), 1.5)
    found = re.search(r'disagree by ([\d.]+) s', text)
    assert found and float(found[1]) == pytest.approx(abs(offset_s), abs=0.15)
    option = re.search(r'offradar convert --position-offset-s (\S+)$', text)
    assert option and float(option[1]) == pytest.approx(-offset_s, abs=0.15)
    (finding,) = seen.clock.findings('gps', moved(seen.trajectory, offset_s), 1.5)
    assert finding.level == 'problem'


@pytest.mark.parametrize('offset_s', [0.0, 0.3, -0.3])
def test_clocks_that_agree_raise_no_alarm(seen: Seen, offset_s: float) -> None:
    assert seen.clock.problem(moved(seen.trajectory, offset_s), 1.5) == ''
    (finding,) = seen.clock.findings('gps', moved(seen.trajectory, offset_s), 1.5)
    assert finding.level == 'ok'
    assert finding.text.endswith('the clocks agree')


def test_positions_of_a_cheap_receiver(seen: Seen) -> None:
    rough = noisy(seen.trajectory, 0.5)
    assert seen.clock.problem(rough, 1.5) == ''
    text = seen.clock.problem(moved(rough, 18.0), 1.5)
    assert 'GPS time is 18 s ahead of UTC' in text
    assert text.endswith('--position-offset-s -18.0')


def test_what_was_given_already_is_part_of_the_option(seen: Seen) -> None:
    text = seen.clock.problem(moved(seen.trajectory, 2.5), 1.5, given_s=10.0)
    assert text.endswith('--position-offset-s 7.5')


def test_positions_of_another_drive_tell_nothing(seen: Seen) -> None:
    reversed_positions = dataclasses.replace(seen.trajectory, positions=seen.trajectory.positions[::-1].copy())
    assert seen.clock.problem(reversed_positions, 1.5) == ''


def test_a_straight_drive_at_constant_speed_cannot_tell(street: Callable[..., Any]) -> None:
    sequence = street(count=150)
    clock = ScanClock()
    for index in range(len(sequence)):
        clock.add(sequence.scan(index))
    for offset_s in (0.0, 5.0):
        (finding,) = clock.findings('gps', moved(sequence.trajectory, offset_s), 1.5)
        assert finding.level == 'note'
        assert 'cannot be told' in finding.text


def test_a_peak_that_is_hardly_higher_than_without_an_offset_is_none(
    seen: Seen, monkeypatch: pytest.MonkeyPatch
) -> None:
    for unmoved, told in ((0.85, False), (0.6, True), (float('nan'), True)):
        found = MotionOffset(1.5, 0.9, unmoved)
        monkeypatch.setattr(check_clocks, 'motion_offset', lambda *_, found=found: found)
        assert bool(seen.clock.problem(seen.trajectory, 1.5)) == told
        (finding,) = seen.clock.findings('gps', seen.trajectory, 1.5)
        assert finding.level == ('problem' if told else 'note')


def test_a_few_scans_of_a_clock_not_yet_set_do_not_hide_an_offset(seen: Seen) -> None:
    clock = ScanClock()
    early = [motion._replace(stamp_ns=motion.stamp_ns % (1000 * SECOND)) for motion in seen.clock._motions[:3]]
    clock._motions = [*seen.clock._motions, *early]
    assert clock.problem(moved(seen.trajectory, 18.0), 1.5) == seen.clock.problem(moved(seen.trajectory, 18.0), 1.5)


def test_a_short_drive_says_nothing(street: Callable[..., Any]) -> None:
    sequence = street(count=10)
    clock = ScanClock()
    for index in range(len(sequence)):
        clock.add(sequence.scan(index))
    assert list(clock.findings('gps', sequence.trajectory, 1.5)) == []


def test_positions_that_stand_still_while_the_scans_move_are_told_of(seen: Seen) -> None:
    standing = np.broadcast_to(seen.trajectory.positions[0], seen.trajectory.positions.shape)
    frozen = dataclasses.replace(seen.trajectory, positions=np.array(standing))
    text = seen.clock.problem(frozen, 1.5)
    assert text.startswith('the positions stay within 0.0 m while the scans move at about ')
    (finding,) = seen.clock.findings('gps', frozen, 1.5)
    assert (finding.level, finding.text) == ('problem', f'gps: {text}')


def test_positions_that_stand_still_as_the_scans_do_are_right() -> None:
    clock = ScanClock()
    plan = session_plan(0, scans=1, seed=4, degraded=0.0)
    sequence = SimulatedSequence(make_city(CityPlan(seed=4)), plan)
    scan, rng = sequence.scan(0), np.random.default_rng(0)
    for k in range(20):
        noise = rng.integers(0, 8, scan.power.shape, np.uint8)
        power = np.clip(scan.power.astype(np.int16) + noise, 0, 255).astype(np.uint8)
        clock.add(dataclasses.replace(scan, stamp_ns=scan.stamp_ns + k * SECOND // 4, power=power))
    stamps_ns = scan.stamp_ns + np.arange(50, dtype=np.int64) * SECOND // 10
    still = Trajectory(stamps_ns, np.zeros((50, 3)), np.full(50, np.nan), geodetic=False)
    assert clock.problem(still, 1.5) == ''


def test_scans_of_noise_alone_say_nothing_of_positions_that_stand_still() -> None:
    clock, rng = ScanClock(), np.random.default_rng(0)
    for k in range(20):
        power = rng.integers(1, 40, (400, 576), np.uint8)
        azimuths = np.linspace(0.0, 2 * np.pi, 400, endpoint=False, dtype=np.float64)
        clock.add(PolarScan(10**18 + k * SECOND // 4, power, azimuths, 0.175))
    stamps_ns = 10**18 + np.arange(50, dtype=np.int64) * SECOND // 10
    still = Trajectory(stamps_ns, np.zeros((50, 3)), np.full(50, np.nan), geodetic=False)
    assert clock.problem(still, 1.5) == ''
