"""Whether a vehicle can have moved from one position to the next."""

from __future__ import annotations

import collections
import math
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint
from offradar_ros.positions.rules import FAR_M
from offradar_ros.types import Pose

FASTEST_MPS = 100.0
"""No vehicle on the ground is faster ..."""
SLACK_M = 30.0
"""... and no receiver's errors change by more than this from one position to the next, unless it jumps."""
_HARDEST_BRAKING_MPS2 = 10.0
_STANDING_MPS = 2.0
# Of a sphere that is the Earth to a third of a per cent.
_EARTH_RADIUS_M = 6_371_000.0
_WINDOW_NS = 2 * 10**9
_LONGEST_STEP_NS = 2 * 10**9
HELD_M = 10.0
"""Positions that a receiver repeats count until the vehicle would be this far ahead of them."""

T = TypeVar('T')
Apart = Callable[[T, T], float]


def points_apart_m(a: Sequence[float], b: Sequence[float]) -> float:
    """Metres along the Earth between two positions that begin with latitude° and longitude°."""
    latitudes = math.radians(a[0]), math.radians(b[0])
    half_latitude = math.sin((latitudes[1] - latitudes[0]) / 2.0) ** 2
    half_longitude = math.sin(math.radians(b[1] - a[1]) / 2.0) ** 2
    chord = half_latitude + math.cos(latitudes[0]) * math.cos(latitudes[1]) * half_longitude
    return 2.0 * _EARTH_RADIUS_M * math.asin(math.sqrt(min(1.0, chord)))


def metres_apart_m(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Metres between two positions that begin with x and y in metres."""
    return math.hypot(b[0] - a[0], b[1] - a[1])


def positions_apart_m(a: GeoPoint | Pose, b: GeoPoint | Pose) -> float:
    """Metres between two positions; 0 where they are not of one kind."""
    if isinstance(a, GeoPoint) and isinstance(b, GeoPoint):
        return points_apart_m((a.latitude_deg, a.longitude_deg), (b.latitude_deg, b.longitude_deg))
    if isinstance(a, Pose) and isinstance(b, Pose):
        return metres_apart_m((a.x_m, a.y_m), (b.x_m, b.y_m))
    return 0.0


def is_jump(apart_m: float, step_ns: int) -> bool:
    """Whether no vehicle moves as far in this time. Positions beyond `FAR_M` are not of one drive, another matter."""
    return not is_drivable(apart_m, step_ns) and apart_m <= FAR_M


def is_drivable(apart_m: float, step_ns: int) -> bool:
    """Whether a vehicle can move as far in this time."""
    return not apart_m > SLACK_M + FASTEST_MPS * step_ns / 1e9


class HeldPosition(Generic[T]):
    """Notices a receiver that repeats its last position while the vehicle drives on, as some do in a tunnel.

    A vehicle that stops brakes first, so the last steps are small. Where the last step is one that no brake ends at
    once, and the same position is repeated from then on, it is held.
    """

    def __init__(self, apart: Apart[T]) -> None:
        self._apart = apart
        self._moved: collections.deque[tuple[int, T]] = collections.deque()
        self._speed_mps = 0.0

    def reset(self) -> None:
        """Forget the positions so far."""
        self._moved.clear()
        self._speed_mps = 0.0

    def add(self, stamp_ns: int, position: T) -> None:
        """A position that is accepted, after `require_new`."""
        if self._moved and self._apart(self._moved[-1][1], position) == 0.0:
            return
        while self._moved and stamp_ns - self._moved[0][0] > _WINDOW_NS:
            self._moved.popleft()
        self._moved.append((stamp_ns, position))
        self._speed_mps = self._speed()

    def require_new(self, stamp_ns: int, position: T) -> None:
        """RefusedInput('position_held') if the position is held, and the vehicle over `HELD_M` away by now."""
        if not self._speed_mps or self._apart(self._moved[-1][1], position) != 0.0:
            return
        since_s = (stamp_ns - self._moved[-1][0]) / 1e9
        if self._speed_mps * since_s > HELD_M:
            raise RefusedInput(
                'position_held',
                f'position stamp {stamp_ns} ns repeats a position of {since_s:.1f} s ago, to which the vehicle came at '
                f'{self._speed_mps:.1f} m/s: the receiver holds it, dropped',
            )

    def _speed(self) -> float:
        """Of the last positions in m/s, 0 where the vehicle may have stopped at the last one."""
        if len(self._moved) < 2:
            return 0.0
        (before_ns, before), (stamp_ns, position) = self._moved[-2], self._moved[-1]
        step_ns = stamp_ns - before_ns
        if not 0 < step_ns <= _LONGEST_STEP_NS:
            return 0.0
        step_s, step_m = step_ns / 1e9, self._apart(before, position)
        could_stop = step_m / step_s <= _STANDING_MPS + _HARDEST_BRAKING_MPS2 * step_s
        if could_stop or step_m > SLACK_M + FASTEST_MPS * step_s:
            return 0.0
        first_ns, first = self._moved[0]
        return self._apart(first, position) / ((stamp_ns - first_ns) / 1e9)
