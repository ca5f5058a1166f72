"""Scan stamps must increase; a large jump back is a recording that starts again."""

from __future__ import annotations

from collections import deque

from offradar_ros.errors import RefusedInput
from offradar_ros.positions.rules import require_stamp

KEPT = 1024
"""Stamps that are remembered: at any usual rate, those of more than `restart_after_ns`."""


class StampGate:
    """Accepts each stamp once, in increasing order."""

    def __init__(self, restart_after_ns: int) -> None:
        self.restart_after_ns = restart_after_ns
        self.reset()

    def reset(self) -> None:
        """Accept any next stamp: the caller knows that a recording starts with it."""
        self._last_ns: int | None = None
        self._seen: deque[int] = deque(maxlen=KEPT)

    def check(self, stamp_ns: int) -> bool:
        """True if the recording restarted: the stamp jumped back by more than `restart_after_ns`.

        RefusedInput('invalid_stamp') as `require_stamp`, RefusedInput('repeated_stamp') for a stamp that came before,
        accepted or not, RefusedInput('stamp_backwards') for another smaller jump back. The next stamp is compared with
        the last accepted one.
        """
        require_stamp(stamp_ns)
        back_ns = 0 if self._last_ns is None else self._last_ns - stamp_ns
        if stamp_ns == self._last_ns or (0 < back_ns <= self.restart_after_ns and stamp_ns in self._seen):
            raise RefusedInput('repeated_stamp', f'stamp {stamp_ns} ns was already received: expected a later one')
        if back_ns > self.restart_after_ns:
            self._seen.clear()
        self._seen.append(stamp_ns)
        if 0 < back_ns <= self.restart_after_ns:
            raise RefusedInput(
                'stamp_backwards',
                f'stamp {stamp_ns} ns is {back_ns / 1e9:.3f} s before the last one: expected a later one, or a jump '
                f'back of more than {self.restart_after_ns / 1e9:g} s where a recording starts again',
            )
        self._last_ns = stamp_ns
        return back_ns > 0
