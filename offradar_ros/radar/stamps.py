"""Scan stamps must increase; a large jump back is a recording that starts again."""

from __future__ import annotations

from offradar_ros.errors import RefusedInput
from offradar_ros.positions.rules import require_stamp


class StampGate:
    """Accepts each stamp once, in increasing order."""

    def __init__(self, restart_after_ns: int) -> None:
        self.restart_after_ns = restart_after_ns
        self._last_ns: int | None = None

    def check(self, stamp_ns: int) -> bool:
        """True if the recording restarted: the stamp jumped back by more than `restart_after_ns`.

        RefusedInput('invalid_stamp') as `require_stamp`, RefusedInput('repeated_stamp') for the last stamp again,
        RefusedInput('stamp_backwards') for a smaller jump back. The next stamp is compared with the last accepted one.
        """
        require_stamp(stamp_ns)
        back_ns = 0 if self._last_ns is None else self._last_ns - stamp_ns
        if self._last_ns is not None and back_ns == 0:
            raise RefusedInput('repeated_stamp', f'stamp {stamp_ns} ns was already received: expected a later one')
        if 0 < back_ns <= self.restart_after_ns:
            raise RefusedInput(
                'stamp_backwards',
                f'stamp {stamp_ns} ns is {back_ns / 1e9:.3f} s before the last one: expected a later one, or a jump '
                f'back of more than {self.restart_after_ns / 1e9:g} s where a recording starts again',
            )
        self._last_ns = stamp_ns
        return back_ns > 0

    def reset(self) -> None:
        """Accept any next stamp: the caller knows that a recording starts with it."""
        self._last_ns = None
