"""The heading of each position: as its source measured it, or the course over ground.

Drivers of odometry that know no orientation send zeros, or the identity for ever, which would be a heading of 0. So a
measured heading counts from its first change on: what never changes is none.
"""

from __future__ import annotations

import collections
import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import LocalFrame, Trajectory, require_next, wrap_angle
from offradar_ros.positions.course import Course, Heading, course_of
from offradar_ros.types import Pose

CHOICES = ('auto', 'source', 'course', 'none')
"""`auto`: the source's where it has one, else the course; `source`, `course`: that alone; `none`: unknown."""
SOURCE_SD_RAD = math.radians(0.5)
"""Standard deviation that a measured heading is taken to have: inertial units state a tenth of a degree, and receivers
and radars are mounted askew by a few."""
_CHANGE_RAD = 1e-6
_TURNED_RAD = math.radians(45.0)


class Headings:
    """Gives each position of a stream its heading.

    A course is known only when the positions after it are, so positions leave in their order, some seconds later than
    they came (`CourseSettings.reach_s`). With a measured heading they leave at once.

    Args:
        choice: one of `CHOICES`.
        max_gap_ns: a longer time between two positions breaks the course.
    """

    def __init__(self, choice: str, max_gap_ns: int) -> None:
        self._choice = choice
        self._max_gap_ns = max_gap_ns
        self._course = Course(max_gap_ns)
        self._waiting: collections.deque[tuple[int, Pose]] = collections.deque()
        self._last_ns: int | None = None
        self._problem = ''
        self.reset()

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last position that was added; None without one."""
        return self._last_ns

    @property
    def problem(self) -> str:
        """What is wrong with the source's headings; empty if nothing is."""
        return self._problem

    def add(self, stamp_ns: int, pose: Pose) -> list[tuple[int, Pose]]:
        """Add a position; returns those that have their heading now, which is NaN where it cannot be told.

        RefusedInput if the position is not finite or not newer than the last.
        """
        require_next(stamp_ns, pose, self._last_ns)
        before: list[tuple[int, Pose]] = []
        if self._last_ns is not None and stamp_ns - self._last_ns > self._max_gap_ns:
            before = self.settle()
            self.reset()
        self._last_ns = stamp_ns
        if self._choice == 'source':
            return [(stamp_ns, pose)]
        if self._choice == 'none':
            return [(stamp_ns, dataclasses.replace(pose, yaw_rad=math.nan, yaw_sd_rad=math.nan))]
        if self._is_measured(pose):
            before += self.settle()
            self._course.reset()
            return [*before, (stamp_ns, pose)]
        self._waiting.append((stamp_ns, pose))
        return before + self._headed(self._course.add(stamp_ns, pose.x_m, pose.y_m))

    def settle(self) -> list[tuple[int, Pose]]:
        """Those that still wait, with what is known now, as when no position will follow."""
        return self._headed(self._course.settle())

    def reset(self) -> None:
        """Forget the positions, and all that they have told, as when they belong to an earlier run."""
        self._course.reset()
        self._waiting.clear()
        self._last_ns = None
        self._changes = False
        self._first_rad = self._first_course_rad = math.nan

    def _is_measured(self, pose: Pose) -> bool:
        if self._choice != 'auto' or math.isnan(pose.yaw_rad):
            return False
        if math.isnan(self._first_rad):
            self._first_rad = pose.yaw_rad
        if abs(pose.yaw_rad - self._first_rad) > _CHANGE_RAD:
            self._changes, self._problem = True, ''
        return self._changes

    def _headed(self, headings: list[Heading]) -> list[tuple[int, Pose]]:
        found = []
        for heading in headings:
            stamp_ns, pose = self._waiting.popleft()
            if not (self._changes and math.isfinite(pose.yaw_rad)):
                self._compare(heading.yaw_rad)
                # Half a turn is as uncertain as a heading can be.
                sd_rad = math.nan if math.isnan(heading.yaw_rad) else min(heading.sd_rad, math.pi)
                pose = dataclasses.replace(pose, yaw_rad=heading.yaw_rad, yaw_sd_rad=sd_rad)
            found.append((stamp_ns, pose))
        return found

    def _compare(self, course_rad: float) -> None:
        """Note where the vehicle turns and the heading of its source does not."""
        if math.isnan(self._first_course_rad):
            self._first_course_rad = course_rad
        turned_rad = abs(math.remainder(course_rad - self._first_course_rad, math.tau))
        if turned_rad > _TURNED_RAD and not self._changes and math.isfinite(self._first_rad):
            self._problem = (
                f'the heading that comes with positions is always {math.degrees(self._first_rad):.1f}°, though the '
                f'vehicle has turned by {math.degrees(turned_rad):.0f}°: its source does not fill it, so headings are '
                'taken from the course over ground (position.heading: course does so without this notice)'
            )


def headings_of(trajectory: Trajectory, choice: str, max_gap_ns: int) -> NDArray[np.float64]:
    """(N, 2) float64 headings of a recorded trajectory and their standard deviations, in rad, NaN where unknown.

    As `Headings`, counter-clockwise from the same axis as `Trajectory.yaws_rad`, but of a recording all of it is known:
    a measured heading that changes at all counts from the start, and a course is known from the start (`course_of`).
    """
    found = np.full((len(trajectory), 2), np.nan)
    measured = np.isfinite(trajectory.yaws_rad)
    if choice == 'auto':
        yaws_rad = trajectory.yaws_rad[measured]
        measured &= bool(len(yaws_rad)) and bool(np.max(np.abs(yaws_rad - yaws_rad[0])) > _CHANGE_RAD)
    elif choice != 'source':
        measured[:] = False
    if choice in ('auto', 'course') and not measured.all():
        origin = trajectory.origin()
        frame = LocalFrame(origin) if origin else None
        found = course_of(trajectory.stamps_ns, trajectory.in_frame(frame).positions, max_gap_ns)
        if frame is not None:
            found[:, 0] = wrap_angle(found[:, 0] - frame.east_rad(trajectory.positions))
    found[measured, 0] = trajectory.yaws_rad[measured]
    found[measured, 1] = SOURCE_SD_RAD
    return found


def with_headings(trajectory: Trajectory, choice: str, max_gap_ns: int) -> Trajectory:
    """The same trajectory with the headings of `headings_of`."""
    return dataclasses.replace(trajectory, yaws_rad=headings_of(trajectory, choice, max_gap_ns)[:, 0])
