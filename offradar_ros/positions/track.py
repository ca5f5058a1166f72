"""The positions of one recorded source as a trajectory, with what was left out."""

from __future__ import annotations

import bisect
import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import LeftOut, Trajectory
from offradar_ros.positions.motion import metres_apart_m, points_apart_m
from offradar_ros.positions.order import FAR_NS, Admitted, PositionOrder
from offradar_ros.positions.rules import FAR_M, geo_point, require_pose
from offradar_ros.types import Pose

RESTART_AFTER_NS = 10**9
"""A smaller step back is an error of one stamp: the default of position.restart_after_s."""

_MOST_PLACES = 64

_Row = tuple[float, float, float, float]
_Stretch = list[tuple[int, _Row]]


class PositionTrack:
    """Collects positions as they arrive, by the rules of the live path, which `PositionOrder` and `rules` hold.

    A recording may start again: where two stretches overlap in time, the positions of the longer one are used.

    Args:
        geodetic: whether positions are latitude°, longitude°, altitude m; else they are metres.
        tally: counts what is left out, by cause; a new one by default.
    """

    def __init__(self, *, geodetic: bool, tally: Counter[str] | None = None) -> None:
        self._geodetic = geodetic
        self._tally: Counter[str] = Counter() if tally is None else tally
        self._first: dict[str, str] = {}
        self._order: PositionOrder[_Row] = PositionOrder(
            RESTART_AFTER_NS, points_apart_m if geodetic else metres_apart_m
        )
        self._stretches: list[_Stretch] = []

    @property
    def tally(self) -> Counter[str]:
        """What was left out so far, by cause."""
        return self._tally

    def leave_out(self, cause: str, first: str = '') -> None:
        """Count a position that is not used; `first` says what is wrong with it."""
        self._tally[cause] += 1
        self._first.setdefault(cause, first)

    def add_point(self, stamp_ns: int, position: tuple[float, float, float], yaw_rad: float = math.nan) -> None:
        """Add latitude°, longitude°, altitude m; RefusedInput, not counted yet, where it is none."""
        point = geo_point(*position)
        self._add(stamp_ns, (point.latitude_deg, point.longitude_deg, point.altitude_m, yaw_rad))

    def add_pose(self, stamp_ns: int, pose: Pose) -> None:
        """Add a pose in metres; RefusedInput, not counted yet, where it is none."""
        require_pose(pose)
        self._add(stamp_ns, (pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad))

    def _add(self, stamp_ns: int, row: _Row) -> None:
        self._admit(self._order.add(stamp_ns, row))

    def _admit(self, admitted: Admitted[_Row]) -> None:
        for refusal in admitted.left_out:
            self.leave_out(refusal.cause, str(refusal))
        if admitted.forgotten:
            self._stretches.pop()
        if admitted.jumped or not self._stretches:
            self._stretches.append([])
        self._stretches[-1] += admitted.positions

    def trajectory(self) -> Trajectory:
        """Every position that is used; empty where there is none."""
        self._admit(self._order.end())
        stretches = self._of_one_time([stretch for stretch in self._stretches if stretch])
        rows = sorted(row for stretch in self._without_overlaps(stretches) for row in stretch)
        stamps_ns = np.array([stamp_ns for stamp_ns, _ in rows], np.int64)
        table = np.array([row for _, row in rows], np.float64).reshape(-1, 4)
        kept = self._of_one_place(table)
        left_out = tuple(LeftOut(cause, count, self._first.get(cause, '')) for cause, count in self._tally.items())
        return Trajectory(stamps_ns[kept], table[kept, :3], table[kept, 3], self._geodetic, left_out)

    def _of_one_time(self, stretches: list[_Stretch]) -> list[_Stretch]:
        """Without stretches that are long before or after the longest one: their clock was not set."""
        longest = max(stretches, key=len, default=[])
        kept = []
        for stretch in stretches:
            away_ns = max(stretch[0][0] - longest[-1][0], longest[0][0] - stretch[-1][0])
            if away_ns <= FAR_NS:
                kept.append(stretch)
                continue
            for stamp_ns, _ in stretch:
                first = (
                    f'position stamp {stamp_ns} ns is {away_ns / 86400e9:.0f} days from those of the others: dropped'
                )
                self.leave_out('position_stamp_jump', first)
        return kept

    def _without_overlaps(self, stretches: list[_Stretch]) -> list[_Stretch]:
        kept: list[_Stretch] = []
        # Of what is kept, in order and apart from one another.
        firsts_ns: list[int] = []
        lasts_ns: list[int] = []
        # Of two that are as long, the later one counts, as on the vehicle, where the earlier one is forgotten.
        numbered = sorted(enumerate(stretches), key=lambda item: (len(item[1]), item[0]), reverse=True)
        for _, stretch in numbered:
            alone = []
            for stamp_ns, row in stretch:
                before = bisect.bisect_right(firsts_ns, stamp_ns)
                if before and stamp_ns <= lasts_ns[before - 1]:
                    first = f'position stamp {stamp_ns} ns lies within another stretch of the recording: dropped'
                    self.leave_out('position_stamp_backwards', first)
                else:
                    alone.append((stamp_ns, row))
            if alone:
                kept.append(alone)
                within = slice(bisect.bisect(firsts_ns, alone[0][0]), bisect.bisect(firsts_ns, alone[-1][0]))
                firsts_ns[within], lasts_ns[within] = [alone[0][0]], [alone[-1][0]]
        return kept

    def _of_one_place(self, table: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(N,) which of (N, 4) rows are not far from all others: those of the largest group."""
        if not self._geodetic:
            return np.ones(len(table), np.bool_)
        rows = table.tolist()
        groups = np.zeros(len(rows), np.intp)
        lasts: list[list[float]] = []
        for index, row in enumerate(rows):
            group = next((at for at, last in enumerate(lasts) if points_apart_m(last, row) <= FAR_M), len(lasts))
            groups[index] = group
            lasts[group : group + 1] = [row] if group < _MOST_PLACES else []
        kept = groups == np.argmax(np.bincount(groups, minlength=1)[:_MOST_PLACES])
        for row in table[~kept]:
            self.leave_out('far_position', f'position {row[0]:.5f}°, {row[1]:.5f}° is far from all others: dropped')
        return np.asarray(kept)
