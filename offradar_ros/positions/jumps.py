"""Positions that no vehicle can have driven to, such as a single fix half a kilometre away.

A scan that is interpolated towards such a position is mapped where the vehicle never was. So a position that jumps is
held, until others confirm the jump or the stream goes on where it was; then those that were held are left out.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.types import Pose

MAX_SPEED_MPS = 100.0
"""No vehicle that carries a radar over a road or rails is faster."""
SLACK_M = 50.0
"""A receiver may be off by this: its error changes from one position to the next, as under bridges and trees."""
CONFIRM_NS = 5 * 10**9
"""Positions that go on for this long after a jump confirm it ..."""
FEWEST_CONFIRMING = 3
"""... if there are this many of them."""
MOST_HELD = 2000
"""As many confirm it in any case: no stream makes memory grow."""


@dataclasses.dataclass(frozen=True)
class Checked:
    """What one position brings about.

    Attributes:
        poses: stamps and poses that count now, in order: those that were held, and this one.
        left_out: why poses that were held do not count.
        jumped: whether `poses` start elsewhere, so that nothing lies between them and those before.
    """

    poses: tuple[tuple[int, Pose], ...] = ()
    left_out: tuple[RefusedInput, ...] = ()
    jumped: bool = False


class PositionJumps:
    """Poses of one map frame, in the order of their stamps; a stamp that goes back starts again."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything: any position may follow."""
        self._last: tuple[int, Pose] | None = None
        self._count = 0
        self._held: list[tuple[int, Pose]] = []

    def add(self, stamp_ns: int, pose: Pose) -> Checked:
        """Accept the pose, or hold it."""
        new = stamp_ns, pose
        left_out: tuple[RefusedInput, ...] = ()
        if self._last is not None and stamp_ns <= (self._held or [self._last])[-1][0]:
            left_out = self._dropped()
            self.reset()
        if self._last is None:
            return self._accepted(new, left_out)
        if self._held and _is_reachable(self._held[-1], new) and self._is_nearer_to_held(pose):
            self._held.append(new)
            return self._confirmed() if self._is_confirmed() else Checked()
        left_out += self._dropped()
        if _is_reachable(self._last, new):
            return self._accepted(new, left_out)
        self._held = [new]
        return Checked(left_out=left_out)

    def end(self) -> Checked:
        """No position follows: what is held counts if it is the larger part."""
        return self._confirmed() if len(self._held) > self._count else Checked(left_out=self._dropped())

    def _accepted(self, new: tuple[int, Pose], left_out: tuple[RefusedInput, ...]) -> Checked:
        self._last = new
        self._count += 1
        return Checked((new,), left_out)

    def _is_nearer_to_held(self, pose: Pose) -> bool:
        return self._last is None or _apart_m(self._held[-1][1], pose) < _apart_m(self._last[1], pose)

    def _is_confirmed(self) -> bool:
        count, span_ns = len(self._held), self._held[-1][0] - self._held[0][0]
        return count >= FEWEST_CONFIRMING and (span_ns >= CONFIRM_NS or count >= MOST_HELD)

    def _confirmed(self) -> Checked:
        held, self._held = self._held, []
        self._last, self._count = held[-1], len(held)
        return Checked(tuple(held), jumped=True)

    def _dropped(self) -> tuple[RefusedInput, ...]:
        held, self._held = self._held, []
        return tuple(_refusal(each, self._last) for each in held if self._last is not None)


def has_jumps(stamps_ns: NDArray[np.int64], xyz_m: NDArray[np.float64]) -> bool:
    """Whether any of (N, 3) positions in metres, by (N,) stamps in order, is out of reach of the one before."""
    apart_m = np.hypot(*np.diff(xyz_m[:, :2], axis=0).T)
    return bool(np.any(apart_m > SLACK_M + MAX_SPEED_MPS * np.diff(stamps_ns) / 1e9))


def _apart_m(one: Pose, other: Pose) -> float:
    """Along the ground: a receiver without an altitude reports 0."""
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)


def _is_reachable(start: tuple[int, Pose], end: tuple[int, Pose]) -> bool:
    seconds = (end[0] - start[0]) / 1e9
    return _apart_m(start[1], end[1]) <= SLACK_M + MAX_SPEED_MPS * seconds


def _refusal(jumped: tuple[int, Pose], last: tuple[int, Pose]) -> RefusedInput:
    seconds = (jumped[0] - last[0]) / 1e9
    return RefusedInput(
        'position_jump',
        f'position at {jumped[0]} ns is {_apart_m(last[1], jumped[1]):.0f} m from the one {seconds:.1f} s before, '
        'farther than a vehicle drives, and those after it are not: dropped',
    )
