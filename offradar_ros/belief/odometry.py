"""The distance that the vehicle drives between two stamps, from odometry."""

from __future__ import annotations

import collections
import math
from typing import NamedTuple

from offradar_ros.errors import RefusedInput
from offradar_ros.types import Pose

MAX_AGE_NS = 500_000_000
"""A position that is older than this does not say where the vehicle is."""

_MOST = 10_000
"""Most positions that are kept while no scan arrives."""


class _Position(NamedTuple):
    stamp_ns: int
    x_m: float
    y_m: float


class Odometry:
    """Positions of the vehicle in any frame that is continuous over a second. Not thread-safe.

    The position at a stamp is the last one up to it, not interpolated: on a vehicle the next one is not known yet, and
    a recording must give the same distances.
    """

    def __init__(self, restart_after_ns: int) -> None:
        self._restart_after_ns = restart_after_ns
        self._positions: collections.deque[_Position] = collections.deque(maxlen=_MOST)

    def add(self, stamp_ns: int, pose: Pose) -> None:
        """Add a position; RefusedInput (`stamp_backwards`) unless it is newer than the last one.

        A stamp that jumps back by more than `restart_after_ns` starts again: a recording is played once more.
        """
        if self._positions and stamp_ns <= (last_ns := self._positions[-1].stamp_ns):
            if last_ns - stamp_ns <= self._restart_after_ns:
                raise RefusedInput(
                    'stamp_backwards',
                    f'odometry of stamp {stamp_ns} ns refused: expected one after the last, {last_ns} ns',
                )
            self._positions.clear()
        self._positions.append(_Position(stamp_ns, pose.x_m, pose.y_m))

    def driven_m(self, start_ns: int, end_ns: int, max_speed_mps: float) -> float | None:
        """Distance from the position at `start_ns` to that at a later `end_ns`; the positions before are forgotten.

        None if one of them is not known, or if they are farther apart than the vehicle can go, as where the origin of
        the odometry was moved.
        """
        start, end = self._at(start_ns), self._at(end_ns)
        while self._positions and end and self._positions[0].stamp_ns < end.stamp_ns:
            self._positions.popleft()
        if start is None or end is None:
            return None
        driven_m = math.hypot(end.x_m - start.x_m, end.y_m - start.y_m)
        possible_m = max_speed_mps * (end_ns - start_ns + MAX_AGE_NS) * 1e-9
        return driven_m if driven_m <= possible_m else None

    def _at(self, stamp_ns: int) -> _Position | None:
        found = None
        for position in self._positions:
            if position.stamp_ns > stamp_ns:
                break
            found = position
        return found if found is not None and stamp_ns - found.stamp_ns <= MAX_AGE_NS else None
