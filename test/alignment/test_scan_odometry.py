"""The velocity of a radar is found from successive scans, or said to be unknown."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from plane import STAMP_NS, TURN_S, Plane, make_plane, make_walls

from offradar_ros.alignment.scan_odometry import LONGEST_S, ScanOdometry
from offradar_ros.alignment.signature import Signature, SignatureMaker
from offradar_ros.alignment.twist import Twist

PLANE = make_plane(1)
MAKE = SignatureMaker()
PERIOD_NS = round(TURN_S * 1e9)


def driven(twist: Twist, count: int, plane: Plane = PLANE) -> list[Signature]:
    """Signatures of successive scans at this velocity."""
    scans, pose = [], np.zeros(3)
    for number in range(count):
        x_m, y_m, yaw_rad = pose.tolist()
        scans.append(MAKE(plane.scan((x_m, y_m, yaw_rad), twist=twist, seed=number)))
        step = twist.pose_after(TURN_S)
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        pose += [cos * step[0] - sin * step[1], sin * step[0] + cos * step[1], step[2]]
    return scans


def found(signatures: list[Signature], odometry: ScanOdometry | None = None, start: int = 0) -> list[Twist | None]:
    odometry = odometry or ScanOdometry()
    return [odometry.twist(one, STAMP_NS + (start + n) * PERIOD_NS) for n, one in enumerate(signatures)]


def assert_near(twist: Twist | None, expected: Twist) -> None:
    """So near that half a turn bends a scan by less than a decimetre and half a degree."""
    assert twist is not None
    assert math.hypot(twist.forward_mps - expected.forward_mps, twist.left_mps - expected.left_mps) < 0.8
    assert abs(twist.yaw_radps - expected.yaw_radps) < 0.07


@pytest.mark.parametrize(
    'twist', [Twist(), Twist(3.0), Twist(15.0), Twist(30.0), Twist(8.0, 0.0, 0.6), Twist(-2.0, 0.0, -0.3)], ids=str
)
def test_the_velocity_is_found_from_the_second_scan_on(twist: Twist) -> None:
    first, *others = found(driven(twist, 4))
    assert first is None
    for other in others:
        assert_near(other, twist)


def test_one_foreign_scan_is_bridged_and_more_are_not() -> None:
    twist = Twist(10.0)
    scans = driven(twist, 14)
    foreign = driven(twist, 1, make_plane(8))[0]
    bridged = found([*scans[:4], foreign, *scans[5:7]])
    assert_near(bridged[4], twist)
    empty = dataclasses.replace(foreign, image=np.zeros_like(foreign.image))
    lost = found([*scans[:4], *[empty] * 6])
    assert_near(lost[4], twist)
    assert lost[-1] is None


def test_after_a_gap_or_another_recording_it_is_unknown() -> None:
    twist, odometry = Twist(10.0), ScanOdometry()
    scans = driven(twist, 4)
    assert_near(found(scans[:2], odometry)[-1], twist)
    assert odometry.twist(scans[2], STAMP_NS + PERIOD_NS + round((LONGEST_S + 0.1) * 1e9)) is None
    assert_near(found(scans[2:], ScanOdometry(), 2)[-1], twist)
    assert_near(found(scans[:2], odometry, 100)[-1], twist)
    odometry.restart()
    assert found(scans[2:3], odometry, 102) == [None]
    # Stamps that jump back are those of another recording.
    assert found(scans[:1], odometry) == [None]


def test_a_velocity_that_no_vehicle_reaches_at_once_is_not_trusted() -> None:
    """Two recordings in one: the same road, ten metres on."""
    scans = driven(Twist(4.0), 8)
    jump = MAKE(PLANE.scan((13.0, 0.0, 0.0), twist=Twist(4.0), seed=3))
    assert found([*scans[:3], jump])[-1] is None


def test_without_stamps_of_rows_it_is_not_looked_for() -> None:
    scans = [dataclasses.replace(one, turn_s=0.0, start_s=0.0) for one in driven(Twist(4.0), 3)]
    assert found(scans) == [None, None, None]


def test_scans_that_do_not_agree_show_no_velocity() -> None:
    """Also where nothing was expected."""
    assert found([*driven(Twist(), 1), *driven(Twist(), 1, make_plane(8))]) == [None, None]


def test_between_walls_without_end_it_is_unknown() -> None:
    """Nothing tells how far along them the vehicle is."""
    assert found(driven(Twist(8.0), 3, make_walls())) == [None, None, None]


def test_faster_than_any_vehicle_is_an_error() -> None:
    scans = [MAKE(PLANE.scan((x_m, 0.0, 0.0))) for x_m in (0.0, 12.0)]
    odometry = ScanOdometry()
    assert odometry.twist(scans[0], STAMP_NS) is None
    assert odometry.twist(scans[1], STAMP_NS + 10**8) is None
    slower = ScanOdometry()
    slower.twist(scans[0], STAMP_NS)
    assert_near(slower.twist(scans[1], STAMP_NS + 4 * 10**8), Twist(30.0))


def test_a_turn_that_no_vehicle_makes_at_once_is_not_trusted() -> None:
    scans = driven(Twist(4.0), 4)
    turned = MAKE(PLANE.scan((4.0, 0.0, math.radians(25.0)), twist=Twist(4.0), seed=3))
    assert found([*scans, turned])[-1] is None
