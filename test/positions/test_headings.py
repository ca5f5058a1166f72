"""Headings of positions: measured where they are measured, else of the way that is driven."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory, wrap_angle
from offradar_ros.positions.course import Course, course_of
from offradar_ros.positions.headings import SOURCE_SD_RAD, Headings, headings_of, with_headings
from offradar_ros.recordings.datasets.positions import read_radar_poses
from offradar_ros.types import Pose

SECOND = 10**9
GAP_NS = 1_500_000_000
SPEED_MPS = 8.0
RADIUS_M = 40.0


def circle(count: int, measured_rad: float | None = None) -> list[tuple[int, Pose]]:
    """A vehicle on a circle at 5 Hz; its headings are right, or always the same."""
    found = []
    for k in range(count):
        yaw_rad = 0.2 * k * SPEED_MPS / RADIUS_M
        where = RADIUS_M * math.sin(yaw_rad), RADIUS_M * (1.0 - math.cos(yaw_rad))
        measured = math.remainder(yaw_rad, math.tau) if measured_rad is None else measured_rad
        found.append((k * SECOND // 5, Pose(*where, 0.5, measured)))
    return found


def true_rad(stamp_ns: int) -> float:
    return math.remainder(stamp_ns / SECOND * SPEED_MPS / RADIUS_M, math.tau)


def through(headings: Headings, positions: list[tuple[int, Pose]]) -> list[tuple[int, Pose]]:
    found = [each for stamp_ns, pose in positions for each in headings.add(stamp_ns, pose)]
    return found + headings.settle()


def errors_deg(found: list[tuple[int, Pose]]) -> NDArray[np.float64]:
    turned = [pose.yaw_rad - true_rad(stamp_ns) for stamp_ns, pose in found]
    return np.abs(np.degrees(wrap_angle(np.array(turned))))


def unmeasured(positions: list[tuple[int, Pose]]) -> list[tuple[int, Pose]]:
    return [(stamp_ns, dataclasses.replace(pose, yaw_rad=math.nan)) for stamp_ns, pose in positions]


@pytest.mark.parametrize('choice', ['auto', 'source', 'course', 'none'])
@pytest.mark.parametrize('measured_rad', [None, math.nan, 0.0, 1.2])
def test_every_position_leaves_once_in_order_and_where_it_was(choice: str, measured_rad: float | None) -> None:
    positions = circle(60, measured_rad)
    found = through(Headings(choice, GAP_NS), positions)
    assert [stamp_ns for stamp_ns, _ in found] == [stamp_ns for stamp_ns, _ in positions]
    assert [(p.x_m, p.y_m, p.z_m) for _, p in found] == [(p.x_m, p.y_m, p.z_m) for _, p in positions]


def test_measured_headings_leave_at_once_and_unchanged() -> None:
    headings, positions = Headings('auto', GAP_NS), circle(30)
    # Of a single one it cannot be told whether it is ever filled.
    assert headings.add(*positions[0]) == []
    assert headings.add(*positions[1]) == positions[:2]
    assert [headings.add(*position) for position in positions[2:]] == [[position] for position in positions[2:]]


@pytest.mark.parametrize('choice', ['auto', 'course'])
def test_positions_without_a_heading_get_that_of_their_way(choice: str) -> None:
    positions = circle(100, math.nan)
    found = through(Headings(choice, GAP_NS), positions)
    assert errors_deg(found).max() < 1.0
    course = Course(GAP_NS)
    expected = [heading for stamp_ns, pose in positions for heading in course.add(stamp_ns, pose.x_m, pose.y_m)]
    expected += course.settle()
    assert [pose.yaw_rad for _, pose in found] == [heading.yaw_rad for heading in expected]
    sds_rad = [heading.sd_rad for heading in expected]
    assert [pose.yaw_sd_rad for _, pose in found] == sds_rad
    assert 0.0 < max(sds_rad) < math.radians(20.0)


def test_a_heading_is_as_certain_as_what_it_is_taken_from() -> None:
    """Of a source that states it, from then on where it is; else of the course, which is poor where it is held long."""
    stated = [(stamp_ns, dataclasses.replace(pose, yaw_sd_rad=0.001)) for stamp_ns, pose in circle(100)]
    found = through(Headings('auto', GAP_NS), stated)
    assert [pose.yaw_sd_rad for _, pose in found[1:]] == [0.001] * 99
    by_course = through(Headings('course', GAP_NS), stated)
    assert min(pose.yaw_sd_rad for _, pose in by_course) > 0.001
    assert all(math.isnan(pose.yaw_sd_rad) for _, pose in through(Headings('none', GAP_NS), stated))
    start_ns, here = circle(100)[-1]
    creeping = [(start_ns + k * SECOND // 5, dataclasses.replace(here, x_m=here.x_m + 0.08 * k)) for k in range(1, 900)]
    held = through(Headings('course', GAP_NS), [*circle(100), *creeping])[-1][1]
    assert math.radians(20.0) < held.yaw_sd_rad <= math.pi


@pytest.mark.parametrize('measured_rad', [0.0, 1.2])
def test_a_heading_that_never_changes_is_none(measured_rad: float) -> None:
    headings = Headings('auto', GAP_NS)
    found = through(headings, circle(100, measured_rad))
    assert errors_deg(found).max() < 1.0
    assert f'always {math.degrees(measured_rad):.1f}°, though the vehicle has turned by' in headings.problem
    assert '\n' not in headings.problem


def test_on_a_straight_way_a_heading_that_does_not_change_is_no_problem() -> None:
    headings = Headings('auto', GAP_NS)
    through(headings, [(k * SECOND // 5, Pose(1.6 * k, 0.0, 0.0, 0.0)) for k in range(100)])
    assert headings.problem == ''


def test_headings_count_from_the_first_change_on() -> None:
    """Odometry starts with the identity, and is right."""
    standing = [(k * SECOND // 5, Pose(0.0, 0.0, 0.0, 0.0)) for k in range(50)]
    moving = [(stamp_ns + 10 * SECOND, pose) for stamp_ns, pose in circle(100)]
    headings = Headings('auto', GAP_NS)
    found = through(headings, [*standing, *moving])
    assert [pose.yaw_rad for _, pose in found[50:]] == [pose.yaw_rad for _, pose in moving]
    # Those that had left before were unknown; the last seconds of them were still there.
    assert math.isnan(found[0][1].yaw_rad)
    assert found[49][1].yaw_rad == 0.0
    assert headings.problem == ''


def test_a_heading_is_filled_where_its_source_has_none() -> None:
    positions = circle(150)
    positions[60:100] = unmeasured(positions[60:100])
    found = through(Headings('auto', GAP_NS), positions)
    assert [pose for _, pose in found[:60]] == [pose for _, pose in positions[:60]]
    assert errors_deg(found).max() < 2.0


def test_the_source_alone_and_none_wait_for_nothing() -> None:
    positions = circle(20, 0.3)
    source, none = Headings('source', GAP_NS), Headings('none', GAP_NS)
    for stamp_ns, pose in positions:
        assert source.add(stamp_ns, pose) == [(stamp_ns, pose)]
        ((_, found),) = none.add(stamp_ns, pose)
        assert math.isnan(found.yaw_rad)


def test_forgotten_positions_do_not_come_back() -> None:
    headings = Headings('course', GAP_NS)
    positions = circle(20, math.nan)
    left = [each for position in positions for each in headings.add(*position)]
    assert headings.last_ns == positions[-1][0]
    headings.reset()
    assert len(left) < 20
    assert headings.settle() == []
    assert headings.last_ns is None
    assert len(through(headings, positions)) == 20


@pytest.mark.parametrize('choice', ['auto', 'source', 'course', 'none'])
def test_a_position_that_is_none_changes_nothing(choice: str) -> None:
    headings = Headings(choice, GAP_NS)
    headings.add(5, Pose(0.0, 0.0))
    for stamp_ns, pose, cause in (
        (5, Pose(1.0, 1.0), 'repeated_position_stamp'),
        (4, Pose(1.0, 1.0), 'position_stamp_backwards'),
        (6, Pose(math.nan, 1.0), 'invalid_position'),
    ):
        with pytest.raises(RefusedInput) as refused:
            headings.add(stamp_ns, pose)
        assert refused.value.cause == cause
    assert headings.last_ns == 5


def trajectory(positions: list[tuple[int, Pose]]) -> Trajectory:
    return Trajectory(
        np.array([stamp_ns for stamp_ns, _ in positions]),
        np.array([(pose.x_m, pose.y_m, pose.z_m) for _, pose in positions]),
        np.array([pose.yaw_rad for _, pose in positions]),
        geodetic=False,
    )


def test_of_a_recording_a_heading_that_changes_counts_from_the_start() -> None:
    standing = [(k * SECOND // 5, Pose(0.0, 0.0, 0.0, 0.0)) for k in range(50)]
    recorded = trajectory([*standing, *[(stamp_ns + 10 * SECOND, pose) for stamp_ns, pose in circle(100)]])
    found = headings_of(recorded, 'auto', GAP_NS)
    np.testing.assert_array_equal(found[:, 0], recorded.yaws_rad)
    assert set(found[:, 1].tolist()) == {SOURCE_SD_RAD}


def test_of_a_recording_the_choices_are_those_of_the_stream() -> None:
    right, constant, unknown = (trajectory(circle(100, measured_rad)) for measured_rad in (None, 0.0, math.nan))
    course = course_of(right.stamps_ns, right.positions, GAP_NS)
    for choice, recorded, expected in (
        ('auto', right, right.yaws_rad),
        ('auto', constant, course[:, 0]),
        ('auto', unknown, course[:, 0]),
        ('source', right, right.yaws_rad),
        ('source', constant, constant.yaws_rad),
        ('source', unknown, unknown.yaws_rad),
        ('course', right, course[:, 0]),
        ('none', right, unknown.yaws_rad),
    ):
        found = with_headings(recorded, choice, GAP_NS)
        np.testing.assert_array_equal(found.yaws_rad, expected, err_msg=choice)
        np.testing.assert_array_equal(found.positions, recorded.positions)


def test_an_empty_trajectory_has_no_headings() -> None:
    nothing = Trajectory(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), geodetic=True)
    assert headings_of(nothing, 'auto', GAP_NS).shape == (0, 2)


@pytest.mark.parametrize('geodetic', [False, True])
def test_a_course_is_from_where_measured_headings_are_from(geodetic: bool) -> None:
    metres = trajectory(circle(200))
    frame = LocalFrame(GeoPoint(60.0, 10.0, 0.0))
    recorded = dataclasses.replace(metres, positions=metres.positions + np.array([50_000.0, 0.0, 0.0]))
    if geodetic:
        points = frame.to_geodetic(recorded.positions)
        yaws_rad = wrap_angle(recorded.yaws_rad - frame.east_rad(points))
        recorded = dataclasses.replace(recorded, positions=points, yaws_rad=yaws_rad, geodetic=True)
    course = with_headings(recorded, 'course', GAP_NS)
    assert np.abs(np.degrees(wrap_angle(course.yaws_rad - recorded.yaws_rad))).max() < 0.8
    again = course.in_frame(frame).yaws_rad
    assert np.abs(np.degrees(wrap_angle(again - metres.yaws_rad))).max() < 0.8


@pytest.mark.parametrize('drive', ['boreas-2021-08-05-13-34', 'boreas-2021-09-02-11-42'])
def test_the_course_of_a_recorded_drive_is_its_measured_heading(real_data: Path, drive: str) -> None:
    recorded = read_radar_poses(real_data / 'boreas' / f'{drive}.radar_poses.csv')
    found = headings_of(recorded, 'course', GAP_NS)
    errors = np.degrees(wrap_angle(found[:, 0] - recorded.yaws_rad))
    # It stands for minutes, at the start and at lights.
    assert np.isfinite(errors).all()
    assert np.abs(np.median(errors)) < 0.3
    assert np.percentile(np.abs(errors), 90) < 1.5
    assert np.percentile(np.abs(errors), 99) < 12.0
    assert np.mean(np.abs(errors) < 2.0 * np.degrees(found[:, 1]) + 0.3) > 0.95
