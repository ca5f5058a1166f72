"""Whether messages still come on an input."""

from __future__ import annotations

import collections
import statistics
import threading
import time
from collections.abc import Callable

FIRST_S = 10.0
"""The first message may take this long: sensors start slowly, and nodes look for one another."""
LEAST_S = 3.0
"""A shorter silence is none."""
PERIODS = 6
"""Usual periods without a message that are a silence: two missing messages are none."""
ERROR_AFTER = 3.0
"""Times that a silence must last to be an error."""
_KEPT = 32


class InputWatch:
    """Silence of one input, in seconds of the steady clock `clock`.

    A message is expected within `FIRST_S`, and then within `PERIODS` times its usual period and not less than
    `LEAST_S`. `received` may be called by another thread.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._since_s = clock()
        self._last_s: float | None = None
        self._periods_s: collections.deque[float] = collections.deque(maxlen=_KEPT)

    def restart(self) -> None:
        """Expect messages from now on, as the node does that becomes active."""
        with self._lock:
            self._since_s, self._last_s = self._clock(), None
            self._periods_s.clear()

    def received(self) -> None:
        """One message came."""
        with self._lock:
            now_s = self._clock()
            if self._last_s is not None:
                self._periods_s.append(now_s - self._last_s)
            self._last_s = now_s

    @property
    def ever(self) -> bool:
        """Whether any message came since the last `restart`."""
        return self._last_s is not None

    @property
    def silent_s(self) -> float:
        """Time since the last message, or since the last `restart` if none came."""
        with self._lock:
            return self._clock() - (self._since_s if self._last_s is None else self._last_s)

    @property
    def patience_s(self) -> float:
        """Silence from which on something is wrong."""
        with self._lock:
            if self._last_s is None:
                return FIRST_S
            usual_s = statistics.median(self._periods_s) if self._periods_s else 0.0
            return max(LEAST_S, PERIODS * usual_s)

    @property
    def is_silent(self) -> bool:
        """Whether a message is overdue."""
        return self.silent_s > self.patience_s

    @property
    def is_dead(self) -> bool:
        """Whether it is overdue for long."""
        return self.silent_s > ERROR_AFTER * self.patience_s
