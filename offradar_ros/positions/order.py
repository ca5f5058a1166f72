"""Positions as they arrive: which go on, which are odd, and where a recording starts again.

One odd stamp or place must neither end a stream nor restart it. So a position that jumps in time, or to where no
vehicle can be by then, is held, until others confirm the jump or the stream goes on where it was; then those that were
held are left out. Of those that confirm a jump in time, the ones that are where the others cannot be are left out, too.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Generic, TypeVar

from offradar_ros.errors import RefusedInput
from offradar_ros.positions.motion import Apart, HeldPosition, is_jump
from offradar_ros.positions.rules import require_stamp

FORWARD_NS = 10 * 10**9
"""A stamp that is later than the last one by more than this is a jump: a gap, or an odd stamp."""
CONFIRM_NS = 2 * 10**9
"""Stamps that go on for this long after a jump confirm it ..."""
FEWEST_CONFIRMING = 3
"""... if there are this many of them, or sooner, if they outnumber all those before the jump."""
MOST_HELD = 1000
"""As many confirm it in any case: no stream makes memory grow."""
FAR_NS = 30 * 86400 * 10**9
SHORT_NS = 10 * 10**9
"""A stretch no longer than `SHORT_NS` that is over `FAR_NS` from what follows has the stamps of a clock not yet set."""

T = TypeVar('T')


@dataclasses.dataclass(frozen=True)
class Admitted(Generic[T]):
    """What one position brings about.

    Attributes:
        positions: stamps and positions that are accepted now, in order: those that were held, and this one.
        left_out: why positions that were held, or accepted before, do not count.
        jumped: whether `positions` start a new stretch; earlier if their stamps are, which is a recording that starts
            again, unless `forgotten`.
        forgotten: whether the whole stretch before has turned out to be odd.
        elsewhere: whether they are where no vehicle can have come from the stretch before: nothing is in between.
    """

    positions: tuple[tuple[int, T], ...] = ()
    left_out: tuple[RefusedInput, ...] = ()
    jumped: bool = False
    forgotten: bool = False
    elsewhere: bool = False


class PositionOrder(Generic[T]):
    """The order of a stream of stamped positions of any type T.

    Args:
        restart_after_ns: a smaller step back is an error of one stamp, a larger one a jump.
        apart: metres between two positions; without it only stamps are looked at.
    """

    def __init__(self, restart_after_ns: int, apart: Apart[T] | None = None) -> None:
        self._restart_after_ns = restart_after_ns
        self._apart: Apart[T] = apart or (lambda _a, _b: math.nan)
        self._receiver = HeldPosition(self._apart)
        self.reset()

    def reset(self) -> None:
        """Forget everything: any stamp may follow."""
        self._first_ns = 0
        self._last_ns: int | None = None
        self._count = 0
        self._held: list[tuple[int, T]] = []
        self._place: tuple[int, T] | None = None
        self._is_elsewhere = False
        self._restart_until_ns: int | None = None
        self._receiver.reset()

    @property
    def last_ns(self) -> int | None:
        """Stamp of the last position that was accepted; None without one."""
        return self._last_ns

    def expect_restart(self) -> Admitted[T]:
        """Believe a jump back at once, the next one or the one that is held: the scans have jumped back too."""
        if self._held and self._last_ns is not None and self._held[0][0] < self._last_ns:
            return self._confirmed()
        self._restart_until_ns = None if self._last_ns is None else self._last_ns + CONFIRM_NS
        return Admitted()

    def add(self, stamp_ns: int, position: T) -> Admitted[T]:
        """Accept the position, hold it, or say by RefusedInput why it is left out.

        RefusedInput: `invalid_stamp`, `repeated_position_stamp`, `position_stamp_backwards` (a small step back),
        `position_held` (the receiver repeats an old one).
        """
        require_stamp(stamp_ns)
        if self._last_ns is None:
            return self._started(stamp_ns, position)
        if not self._held:
            return self._continued(stamp_ns, position)
        if self._is_elsewhere:
            return self._added_elsewhere(stamp_ns, position)
        held_ns = self._held[-1][0]
        # Else a second jump, elsewhere: what was held stays unconfirmed.
        if self._goes_on_from_before(stamp_ns) or held_ns - stamp_ns > self._restart_after_ns:
            return self._continued(stamp_ns, position)
        self._require_later(stamp_ns, held_ns)
        self._held.append((stamp_ns, position))
        return self._confirmed() if self._is_confirmed() else Admitted()

    def end(self) -> Admitted[T]:
        """No position follows: what is held is accepted after a gap, and after a jump back if it is the larger part."""
        if not self._held or self._last_ns is None:
            return Admitted()
        is_gap = self._held[0][0] > self._last_ns and not self._is_far() and not self._is_elsewhere
        if is_gap or len(self._held) > self._count:
            return self._confirmed()
        return Admitted(left_out=self._dropped())

    def _started(self, stamp_ns: int, position: T) -> Admitted[T]:
        self._first_ns, self._last_ns, self._count = stamp_ns, stamp_ns, 1
        self._place = stamp_ns, position
        self._receiver.add(stamp_ns, position)
        return Admitted(((stamp_ns, position),))

    def _continued(self, stamp_ns: int, position: T) -> Admitted[T]:
        """With what was held left out, unless the position is refused: then that is held on."""
        last_ns = self._last_ns or 0
        step_ns = stamp_ns - last_ns
        if -self._restart_after_ns <= step_ns <= 0:
            self._require_later(stamp_ns, last_ns)
        left_out = self._dropped()
        if step_ns > FORWARD_NS or step_ns < 0:
            self._held = [(stamp_ns, position)]
            if step_ns < 0 and self._restart_until_ns is not None:
                confirmed = self._confirmed()
                return dataclasses.replace(confirmed, left_out=(*left_out, *confirmed.left_out))
            return Admitted(left_out=left_out)
        if self._restart_until_ns is not None and stamp_ns > self._restart_until_ns:
            self._restart_until_ns = None
        if self._is_jump(self._place, stamp_ns, position):
            self._held, self._is_elsewhere = [(stamp_ns, position)], True
            return Admitted(left_out=left_out)
        self._last_ns = stamp_ns
        if not left_out:
            # Else those that were held are told of first.
            self._receiver.require_new(stamp_ns, position)
        self._receiver.add(stamp_ns, position)
        self._place = stamp_ns, position
        self._count += 1
        return Admitted(((stamp_ns, position),), left_out)

    def _added_elsewhere(self, stamp_ns: int, position: T) -> Admitted[T]:
        """With positions held that are where no vehicle can be by then."""
        held_ns, held = self._held[-1]
        if -self._restart_after_ns <= stamp_ns - held_ns <= 0:
            self._require_later(stamp_ns, held_ns)
        goes_on = 0 < stamp_ns - held_ns <= FORWARD_NS and not self._is_jump(self._held[-1], stamp_ns, position)
        is_back = self._place is not None and self._apart(self._place[1], position) < self._apart(held, position)
        if not goes_on or is_back:
            return self._continued(stamp_ns, position)
        self._held.append((stamp_ns, position))
        return self._confirmed() if self._is_confirmed() else Admitted()

    def _is_jump(self, before: tuple[int, T] | None, stamp_ns: int, position: T) -> bool:
        return before is not None and is_jump(self._apart(before[1], position), stamp_ns - before[0])

    def _goes_on_from_before(self, stamp_ns: int) -> bool:
        """Whether a stamp belongs to the stretch before the jump rather than to the held ones."""
        last_ns, first_held_ns, held_ns = self._last_ns or 0, self._held[0][0], self._held[-1][0]
        if first_held_ns > last_ns:
            return last_ns - self._restart_after_ns <= stamp_ns < first_held_ns - self._restart_after_ns
        # However long after: one odd stamp before a gap is no recording that starts again.
        return last_ns < stamp_ns and stamp_ns - held_ns > self._restart_after_ns

    def _require_later(self, stamp_ns: int, last_ns: int) -> None:
        if stamp_ns == last_ns:
            raise RefusedInput('repeated_position_stamp', f'position stamp {stamp_ns} ns was there before: dropped')
        if stamp_ns < last_ns:
            raise RefusedInput(
                'position_stamp_backwards',
                f'position stamp {stamp_ns} ns goes back by {(last_ns - stamp_ns) / 1e9:g} s: expected growing stamps',
            )

    def _is_confirmed(self) -> bool:
        count, span_ns = len(self._held), self._held[-1][0] - self._held[0][0]
        return count >= FEWEST_CONFIRMING and (span_ns >= CONFIRM_NS or count > self._count or count >= MOST_HELD)

    def _is_far(self) -> bool:
        """Whether the jump is too large for a gap or a recording that starts again."""
        return abs(self._held[0][0] - (self._last_ns or 0)) > FAR_NS

    def _confirmed(self) -> Admitted[T]:
        last_ns, elsewhere = self._last_ns or 0, self._is_elsewhere
        is_short = last_ns - self._first_ns <= SHORT_NS
        odd = is_short and (len(self._held) > self._count if elsewhere else self._is_far())
        left_out = [self._refusal(last_ns, self._held[0][0]) for _ in range(self._count)] if odd else []
        positions, outliers = self._of_one_place()
        self._first_ns, self._last_ns, self._count = positions[0][0], positions[-1][0], len(positions)
        self._held, self._is_elsewhere, self._restart_until_ns = [], False, None
        self._place = positions[-1]
        self._receiver.reset()
        return Admitted(positions, (*left_out, *outliers), jumped=True, forgotten=odd, elsewhere=elsewhere)

    def _of_one_place(self) -> tuple[tuple[tuple[int, T], ...], list[RefusedInput]]:
        """Of those held, the most that a vehicle can have driven along, and why the others are left out."""
        ways: list[list[tuple[int, T]]] = []
        for held in self._held:
            way = next((way for way in ways if not self._is_jump(way[-1], *held)), None)
            if way is None:
                ways.append([held])
            else:
                way.append(held)
        longest = max(ways, key=len)
        outliers = [
            _place_jump(stamp_ns, self._apart(longest[0][1], position), longest[0][0])
            for way in ways
            if way is not longest
            for stamp_ns, position in way
        ]
        return tuple(longest), outliers

    def _dropped(self) -> tuple[RefusedInput, ...]:
        dropped = tuple(self._refusal(stamp_ns, self._last_ns or 0) for stamp_ns, _ in self._held)
        self._held, self._is_elsewhere = [], False
        return dropped

    def _refusal(self, stamp_ns: int, other_ns: int) -> RefusedInput:
        """Why a position is left out: the one with this stamp contradicts those around the other one."""
        if not self._is_elsewhere or self._place is None:
            return _jump(stamp_ns, other_ns)
        return _place_jump(stamp_ns, self._apart(self._place[1], self._held[0][1]), other_ns)


def _place_jump(stamp_ns: int, apart_m: float, other_ns: int) -> RefusedInput:
    return RefusedInput(
        'position_jump',
        f'position stamp {stamp_ns} ns is {apart_m:.0f} m from one that is {abs(stamp_ns - other_ns) / 1e9:.1f} s '
        'away: no vehicle is that fast, dropped',
    )


def _jump(stamp_ns: int, other_ns: int) -> RefusedInput:
    apart_s = (stamp_ns - other_ns) / 1e9
    return RefusedInput(
        'position_stamp_jump',
        f'position stamp {stamp_ns} ns is {abs(apart_s):.1f} s {"after" if apart_s > 0 else "before"} those around it: '
        'dropped',
    )
