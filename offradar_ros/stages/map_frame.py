"""The origin of the map's frame: a position that most others agree with."""

from __future__ import annotations

import collections
from collections.abc import Sequence

import numpy as np

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame
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
    then they were right, and the first of them is the origin. After `settle`, or with an origin given, it stays.
    """

    def __init__(self, origin: GeoPoint | None) -> None:
        self._frame = LocalFrame(origin) if origin else None
        self._is_settled = origin is not None
        self._near = 0
        self._far = 0
        self._others: collections.deque[tuple[int, GeoPoint]] = collections.deque(maxlen=_MOST_HELD)
        self._other_frame: LocalFrame | None = None

    @property
    def origin(self) -> GeoPoint | None:
        """The origin; None without a position."""
        return self._frame.origin if self._frame else None

    def settle(self) -> None:
        """Keep the origin from now on: a session that uses it has ended."""
        self._is_settled = self._frame is not None

    def place(self, stamp_ns: int, point: GeoPoint) -> tuple[Sequence[tuple[int, Pose]], list[RefusedInput], bool]:
        """The poses that follow from a position, why earlier ones do not count, and whether the origin has moved.

        After a move the poses are those of every position near the new origin, and earlier poses are void.
        RefusedInput('far_position') where the origin is settled.
        """
        if self._frame is None:
            self._frame = LocalFrame(point)
        pose = _pose(self._frame, point)
        if _is_near(pose):
            self._near += 1
            return [(stamp_ns, pose)], [], False
        self._far += 1
        if self._is_settled:
            raise self._refusal(point)
        left_out = self._held_with_others(stamp_ns, point)
        if self._far <= self._near:
            return [], left_out, False
        return self._moved(left_out)

    def take_far(self) -> list[RefusedInput]:
        """Why positions that are far from the origin, and are the fewer so far, do not count."""
        left_out = [self._refusal(point) for _, point in self._others]
        self._others.clear()
        return left_out

    def problem(self) -> str:
        """What is wrong with the origin, and what to do; empty if nothing is."""
        origin = self.origin
        if origin is None:
            return ''
        if max(abs(origin.latitude_deg), abs(origin.longitude_deg)) < NULL_ISLAND_DEG:
            return f"the map's origin is 0°, 0°, which stands for no fix, so the map is of no use: {_REMEDY}"
        if self._is_settled and self._far >= _FEWEST_FAR and not self._near:
            return (
                f"the map's origin {origin.latitude_deg:.5f}°, {origin.longitude_deg:.5f}° is over "
                f'{FAR_M / 1000.0:.0f} km from every position: the map is of another place (use another map.path), or '
                f'its origin was a wrong fix: {_REMEDY}'
            )
        return ''

    def _held_with_others(self, stamp_ns: int, point: GeoPoint) -> list[RefusedInput]:
        left_out: list[RefusedInput] = []
        if self._other_frame is None or not _is_near(_pose(self._other_frame, point)):
            left_out = self.take_far()
            self._other_frame, self._far = LocalFrame(point), 1
        self._others.append((stamp_ns, point))
        return left_out

    def _moved(self, left_out: list[RefusedInput]) -> tuple[Sequence[tuple[int, Pose]], list[RefusedInput], bool]:
        assert self._other_frame is not None
        assert self._frame is not None
        before = self._frame.origin
        self._frame, self._other_frame = self._other_frame, None
        left_out = [*left_out, *(self._refusal(before) for _ in range(self._near))]
        poses = [(stamp_ns, _pose(self._frame, point)) for stamp_ns, point in self._others]
        self._near, self._far = len(poses), 0
        self._others.clear()
        return poses, left_out, True

    def _refusal(self, point: GeoPoint) -> RefusedInput:
        assert self._frame is not None
        kilometres = float(np.linalg.norm(_enu(self._frame, point))) / 1000.0
        return RefusedInput(
            'far_position',
            f'position {point.latitude_deg:.5f}°, {point.longitude_deg:.5f}° is {kilometres:.0f} km from the '
            f"map's origin: expected at most {FAR_M / 1000.0:.0f} km",
        )


def _enu(frame: LocalFrame, point: GeoPoint) -> tuple[float, float, float]:
    x_m, y_m, z_m = frame.to_enu(np.array([[point.latitude_deg, point.longitude_deg, point.altitude_m]]))[0].tolist()
    return x_m, y_m, z_m


def _pose(frame: LocalFrame, point: GeoPoint) -> Pose:
    return Pose(*_enu(frame, point))


def _is_near(pose: Pose) -> bool:
    return bool(np.linalg.norm((pose.x_m, pose.y_m, pose.z_m)) <= FAR_M)
