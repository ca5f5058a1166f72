"""A scan counts once, also where two programs send it."""

from __future__ import annotations

import collections

from offradar_ros.errors import RefusedInput

KEPT = 1024
"""Scans that are remembered: of two programs that do the same work, one may lag behind."""


class SeenStamps:
    """Accepts each stamp of a model once, in any order, until a recording starts again.

    Args:
        restart_after_ns: a stamp that is farther back than this from the newest starts a recording, and with it all
            stamps are new.
    """

    def __init__(self, restart_after_ns: int) -> None:
        self._restart_after_ns = restart_after_ns
        self._seen: collections.OrderedDict[tuple[str, int], None] = collections.OrderedDict()
        self._newest_ns = 0

    def check(self, stamp_ns: int, model: str) -> None:
        """RefusedInput('repeated_scan') for a scan that came already."""
        if self._newest_ns - stamp_ns > self._restart_after_ns:
            self.reset()
        key = (model, stamp_ns)
        if key in self._seen:
            raise RefusedInput(
                'repeated_scan',
                f'scan {stamp_ns} ns came already from the same model: it counts once; do two encoders run?',
            )
        self._newest_ns = max(self._newest_ns, stamp_ns)
        self._seen[key] = None
        if len(self._seen) > KEPT:
            self._seen.popitem(last=False)

    def reset(self) -> None:
        """Accept every stamp again: the caller knows that a recording starts."""
        self._seen.clear()
        self._newest_ns = 0
