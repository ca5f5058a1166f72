"""The origin of the map's frame: a position that most others agree with."""

from __future__ import annotations

import collections

import numpy as np

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LeftOut, LocalFrame
from offradar_ros.positions.motion import is_drivable, positions_apart_m
from offradar_ros.positions.order import FORWARD_NS
from offradar_ros.positions.rules import FAR_M, NULL_ISLAND_DEG
from offradar_ros.types import Pose

_MOST_HELD = 4096
_FEWEST_FAR = 10
_REMEDY = (
    'undo its sessions or clear it, and the origin goes with its places (map.allow_destructive allows that), or use '
    'another map.path'
)


class MapFrame:
    """Positions to poses in the map's frame.

    The first position is the origin until positions over `FAR_M` from it, near one another, outnumber those near it:
    then they were right, and after `move` the first of them is the origin. With an origin given, after `settle`, and
    where the vehicle has driven out of its reach, so that it was right, the origin stays.
    """

    def __init__(self, origin: GeoPoint | None) -> None:
        self._frame = LocalFrame(origin) if origin else None
        self._is_settled = origin is not None
        self._near = 0
        self._far = 0
        self._last_near: tuple[int, GeoPoint] | None = None
        self._others: collections.deque[tuple[int, GeoPoint]] = collections.deque()
        self._other_frame: LocalFrame | None = None

    @property
    def origin(self) -> GeoPoint | None:
        """The origin; None without a position."""
        return self._frame.origin if self._frame else None

    @property
    def is_outvoted(self) -> bool:
        """Whether most positions contradict the origin: `move` it."""
        return not self._is_settled and self._far > self._near

    def settle(self) -> None:
        """Keep the origin from now on: a session that uses it has ended."""
        self._is_settled = self._frame is not None

    def place(self, stamp_ns: int, point: GeoPoint) -> tuple[Pose | None, list[LeftOut]]:
        """The pose of a position, or None for one that is held, and those held before that do not count now.

        RefusedInput('far_position') where the origin is settled.
        """
        if self._frame is None:
            self._frame = LocalFrame(point)
        pose = _pose(self._frame, point)
        if _is_near(pose):
            self._near += 1
            self._last_near = stamp_ns, point
            if self._is_settled:
                self._far = 0
            return pose, []
        self._far += 1
        self._is_settled = self._is_settled or self._is_driven_out(stamp_ns, point)
        self._last_near = None
        if self._is_settled:
            raise self._refusal(point)
        return None, self._held_with_others(stamp_ns, point)

    def move(self) -> tuple[list[tuple[int, Pose]], LeftOut]:
        """The poses of all positions near the new origin, and those before, whose poses are void."""
        assert self._other_frame is not None
        assert self._frame is not None
        before = self._frame.origin
        self._frame, self._other_frame = self._other_frame, None
        left_out = _left_out(self._refusal(before), self._near)
        poses = [(stamp_ns, _pose(self._frame, point)) for stamp_ns, point in self._others]
        self._near, self._far, self._last_near = len(poses), 0, None
        self._others.clear()
        return poses, left_out

    def take_far(self) -> list[LeftOut]:
        """The positions that are far from the origin, and are the fewer so far: they do not count."""
        if not self._others:
            return []
        left_out = _left_out(self._refusal(self._others[0][1]), len(self._others))
        self._others.clear()
        return [left_out]

    def problem(self) -> str:
        """What is wrong with the origin, and what to do; empty if nothing is."""
        origin = self.origin
        if origin is None:
            return ''
        if max(abs(origin.latitude_deg), abs(origin.longitude_deg)) < NULL_ISLAND_DEG:
            return f"the map's origin is 0°, 0°, which stands for no fix, so the map is of no use: {_REMEDY}"
        if not self._is_settled or self._far < _FEWEST_FAR:
            return ''
        where = f"the map's origin {origin.latitude_deg:.5f}°, {origin.longitude_deg:.5f}°"
        if self._near:
            return (
                f'the last {self._far} positions are over {FAR_M / 1000.0:.0f} km from {where}, and are not mapped: '
                'use another map.path there'
            )
        return (
            f'{where} is over {FAR_M / 1000.0:.0f} km from every position: the map is of another place (use another '
            f'map.path), or its origin was a wrong fix: {_REMEDY}'
        )

    def _is_driven_out(self, stamp_ns: int, point: GeoPoint) -> bool:
        """Whether the vehicle has come here from a position that is near the origin."""
        if self._last_near is None:
            return False
        last_ns, last = self._last_near
        return 0 < stamp_ns - last_ns <= FORWARD_NS and is_drivable(positions_apart_m(last, point), stamp_ns - last_ns)

    def _held_with_others(self, stamp_ns: int, point: GeoPoint) -> list[LeftOut]:
        left_out: list[LeftOut] = []
        if self._other_frame is None or not _is_near(_pose(self._other_frame, point)):
            left_out = self.take_far()
            self._other_frame, self._far = LocalFrame(point), 1
        elif self._others and stamp_ns <= self._others[-1][0]:
            # The recording starts again; those before it still say where the vehicle is.
            left_out = self.take_far()
        elif len(self._others) == _MOST_HELD:
            left_out = [_left_out(self._refusal(self._others.popleft()[1]), 1)]
        self._others.append((stamp_ns, point))
        return left_out

    def _refusal(self, point: GeoPoint) -> RefusedInput:
        assert self._frame is not None
        kilometres = float(np.linalg.norm(_enu(self._frame, point))) / 1000.0
        return RefusedInput(
            'far_position',
            f'position {point.latitude_deg:.5f}°, {point.longitude_deg:.5f}° is {kilometres:.0f} km from the '
            f"map's origin: expected at most {FAR_M / 1000.0:.0f} km",
        )


def _left_out(refusal: RefusedInput, count: int) -> LeftOut:
    return LeftOut(refusal.cause, count, str(refusal))


def _enu(frame: LocalFrame, point: GeoPoint) -> tuple[float, float, float]:
    x_m, y_m, z_m = frame.to_enu(np.array([[point.latitude_deg, point.longitude_deg, point.altitude_m]]))[0].tolist()
    return x_m, y_m, z_m


def _pose(frame: LocalFrame, point: GeoPoint) -> Pose:
    return Pose(*_enu(frame, point))


def _is_near(pose: Pose) -> bool:
    return bool(np.linalg.norm((pose.x_m, pose.y_m, pose.z_m)) <= FAR_M)
