"""Positions where no vehicle can be, and positions that a receiver repeats while the vehicle drives on."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.positions.motion import points_apart_m, positions_apart_m
from offradar_ros.positions.order import PositionOrder
from offradar_ros.positions.track import PositionTrack
from offradar_ros.types import Pose

START_NS = 1_767_225_600 * 10**9


def track(positions_m: list[float], rate_hz: float = 10.0) -> tuple[Trajectory, Counter[str]]:
    """Of positions along a line, in metres."""
    return stamped([(k / rate_hz, x_m) for k, x_m in enumerate(positions_m)])


def stamped(fixes: list[tuple[float, float]]) -> tuple[Trajectory, Counter[str]]:
    """Of seconds and metres along a line."""
    made = PositionTrack(geodetic=False)
    for after_s, x_m in fixes:
        try:
            made.add_pose(START_NS + round(after_s * 1e9), Pose(x_m, 0.0))
        except RefusedInput as refused:
            made.leave_out(refused.cause)
    return made.trajectory(), made.tally


def drive(count: int, speed_mps: float = 8.0, start_m: float = 0.0, rate_hz: float = 10.0) -> list[float]:
    return [start_m + speed_mps * k / rate_hz for k in range(count)]


def test_a_drive_is_used_as_it_is() -> None:
    for speed_mps in (0.0, 0.3, 8.0, 90.0):
        for rate_hz in (1.0, 10.0, 50.0):
            found, tally = track(drive(200, speed_mps, rate_hz=rate_hz), rate_hz)
            assert (len(found), tally) == (200, {})


@pytest.mark.parametrize('away_m', [-500.0, 100.0, 20_000.0, 86_000.0])
@pytest.mark.parametrize('odd', [1, 2, 10])
def test_positions_where_no_vehicle_can_be_are_left_out(away_m: float, odd: int) -> None:
    positions = drive(100)
    for k in range(40, 40 + odd):
        positions[k] += away_m
    found, tally = track(positions)
    assert tally == {'position_jump': odd}
    assert found.positions[:, 0].max() < 100.0
    assert len(found) == 100 - odd


def test_positions_that_run_away_faster_than_any_vehicle_are_left_out() -> None:
    positions = drive(100)
    for k in range(40, 65):
        positions[k] = 5000.0 + 1000.0 * (k - 40)
    found, tally = track(positions)
    assert (len(found), tally) == (75, {'position_jump': 25})


def test_one_odd_position_of_a_slow_receiver_is_left_out() -> None:
    """The next one is near enough to both, and nearer to those before."""
    positions = drive(100, rate_hz=1.0)
    positions[40] += 135.0
    found, tally = track(positions, rate_hz=1.0)
    assert (len(found), tally) == (99, {'position_jump': 1})


def test_an_odd_position_at_the_end_is_left_out() -> None:
    found, tally = track([*drive(100), 5000.0, 5000.8])
    assert (len(found), tally) == (100, {'position_jump': 2})


def test_an_odd_position_is_not_confirmed_by_one_after_a_gap() -> None:
    fixes = [(k / 10, x_m) for k, x_m in enumerate(drive(50))]
    fixes += [(5.0, 3000.0)] + [(65.0 + k / 10, x_m) for k, x_m in enumerate(drive(50, start_m=3000.0))]
    found, tally = stamped(fixes)
    assert (len(found), tally) == (100, {'position_jump': 1})


def test_a_vehicle_that_is_moved_is_followed_also_where_each_position_comes_twice() -> None:
    positions = [*drive(50), *drive(50, start_m=3000.0)]
    found, tally = stamped([(k / 10, x_m) for k, x_m in enumerate(positions) for _ in range(2)])
    assert (len(found), tally) == (100, {'repeated_position_stamp': 100})


def test_every_odd_position_is_counted_while_the_receiver_holds_another() -> None:
    before = drive(100)
    positions = [*before, *[before[-1]] * 30, 2000.0, *[before[-1]] * 30]
    found, tally = track(positions)
    assert tally['position_jump'] == 1
    assert len(found) + tally.total() == len(positions)


def test_a_receiver_whose_errors_are_those_of_a_street_is_used() -> None:
    found, tally = track([x_m + (10.0 if k % 2 else -10.0) for k, x_m in enumerate(drive(100))])
    assert (len(found), tally) == (100, {})


def test_first_positions_of_the_place_where_the_receiver_was_switched_off_are_left_out() -> None:
    found, tally = track([5000.0, 5000.0, *drive(100)])
    assert tally == {'position_jump': 2}
    assert len(found) == 100


def test_a_vehicle_that_is_moved_is_followed() -> None:
    found, tally = track([*drive(50), *drive(50, start_m=3000.0)])
    assert (len(found), tally) == (100, {})


@pytest.mark.parametrize(('speed_mps', 'rate_hz'), [(8.0, 10.0), (20.0, 10.0), (25.0, 1.0), (8.0, 50.0)])
def test_a_position_that_the_receiver_holds_is_left_out(speed_mps: float, rate_hz: float) -> None:
    before = drive(round(10 * rate_hz), speed_mps, rate_hz=rate_hz)
    held = [before[-1]] * round(20 * rate_hz)
    after = drive(round(10 * rate_hz), speed_mps, before[-1] + 20 * speed_mps, rate_hz)
    found, tally = track([*before, *held, *after], rate_hz)
    stale_s = (found.stamps_ns[found.positions[:, 0] == before[-1]].max() - START_NS) / 1e9 - 10.0
    assert stale_s * speed_mps <= 10.0
    assert tally['position_held'] >= (20.0 - 10.0 / speed_mps) * rate_hz - 2
    assert (found.positions[:, 0] >= after[0]).sum() >= len(after) - 1


def test_a_position_is_held_by_the_speed_of_the_last_seconds() -> None:
    before = [*drive(1000, 1.0), *drive(40, 20.0, 100.0)]
    found, tally = track([*before, *[before[-1]] * 50])
    assert tally == {'position_held': 50 - 5}
    assert len(found) == len(before) + 5


def test_positions_that_come_seldom_do_not_tell_that_one_is_held() -> None:
    assert track([0.0, 120.0, 240.0, 240.0, 240.0], rate_hz=1 / 3)[1] == {}


def test_a_jump_to_another_region_is_no_speed() -> None:
    order: PositionOrder[float] = PositionOrder(10**9, lambda a, b: abs(b - a))
    for k, x_m in enumerate([*drive(50), *[300_000.0] * 50]):
        assert len(order.add(START_NS + k * 10**8, x_m).positions) == 1


def test_a_vehicle_that_brakes_and_stands_keeps_its_position() -> None:
    """Receivers that hold the position of a vehicle that stands still are right."""
    braking, speed_mps, x_m = [], 15.0, 80.0
    while speed_mps > 0.0:
        x_m += speed_mps / 10
        braking.append(x_m)
        speed_mps -= 0.8
    found, tally = track([*drive(100), *braking, *[braking[-1]] * 600])
    assert tally == {}
    assert len(found) == 700 + len(braking)


def test_a_receiver_of_whole_metres_is_used() -> None:
    found, tally = track([float(round(x_m)) for x_m in drive(300)])
    assert (len(found), tally) == (300, {})


def test_a_second_receiver_rate_that_repeats_each_position_is_used() -> None:
    found, tally = track([8.0 * (k // 10) for k in range(300)])
    assert (len(found), tally) == (300, {})


def test_metres_apart_are_those_of_the_local_frame() -> None:
    a = (51.75, -1.25)
    ((latitude, longitude, _),) = LocalFrame(GeoPoint(*a)).to_geodetic(np.array([[3000.0, 4000.0, 0.0]])).tolist()
    b = (latitude, longitude)
    assert points_apart_m(a, b) == pytest.approx(5000.0, rel=0.005)
    assert points_apart_m((0.0, 179.9, 60.0), (0.0, -179.9, 60.0)) == pytest.approx(0.2 * 111_195, rel=0.001)
    assert positions_apart_m(GeoPoint(*a), GeoPoint(*b)) == points_apart_m(a, b)
    assert positions_apart_m(Pose(0.0, 0.0), Pose(3.0, 4.0)) == 5.0
    assert positions_apart_m(GeoPoint(*a), Pose(0.0, 0.0)) == 0.0
