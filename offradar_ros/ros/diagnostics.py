"""Rates, latencies and drops of one node, once a second on /diagnostics."""

from __future__ import annotations

import collections
import threading
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from offradar_ros.ros.stamps import header

WINDOW = 256


class NodeStatus:
    """Counts what a node handled and dropped; latencies in seconds over the last `WINDOW` messages.

    `handle`, `drop` and `message` may be called by several threads. `clock` is the steady clock, in seconds.
    """

    def __init__(self, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._name = name
        self._clock = clock
        self.handled = 0
        self.drops: Counter[str] = Counter()
        self.counts: Counter[str] = Counter()
        self.facts: dict[str, str] = {}
        self.warning = ''
        self._latencies_s: collections.deque[float] = collections.deque(maxlen=WINDOW)
        self._last_report_s = clock()
        self._last_handled = 0
        self._last_drops = 0
        self._lock = threading.Lock()

    def handle(self, received_s: float) -> None:
        """One message handled, received at `received_s` of the steady clock."""
        with self._lock:
            self.handled += 1
            self._latencies_s.append(self._clock() - received_s)

    def drop(self, cause: str, count: int = 1) -> None:
        """One message dropped, or `count` of them."""
        with self._lock:
            self.drops[cause] += count

    def message(self, stamp_ns: int) -> DiagnosticArray:
        """Report, and start the next period; WARN if anything was dropped in this one."""
        with self._lock:
            return self._message(stamp_ns)

    def _message(self, stamp_ns: int) -> DiagnosticArray:
        now_s = self._clock()
        rate_hz = (self.handled - self._last_handled) / max(now_s - self._last_report_s, 1e-9)
        dropped = self.drops.total()
        new_drops = dropped - self._last_drops
        self._last_report_s, self._last_handled, self._last_drops = now_s, self.handled, dropped
        values = {'handled': str(self.handled), 'rate_hz': f'{rate_hz:.2f}', 'dropped': str(dropped)}
        if self._latencies_s:
            p50, p99 = np.percentile(np.fromiter(self._latencies_s, np.float64), [50, 99]) * 1e3
            values |= {'latency_p50_ms': f'{p50:.2f}', 'latency_p99_ms': f'{p99:.2f}'}
        values |= {f'dropped.{cause}': str(count) for cause, count in sorted(self.drops.items())}
        values |= {name: str(count) for name, count in sorted(self.counts.items())} | self.facts
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if new_drops or self.warning else DiagnosticStatus.OK,
            name=self._name,
            message=f'{new_drops} dropped in the last period' if new_drops else self.warning or f'{rate_hz:.1f} Hz',
            hardware_id='offradar_ros',
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        return DiagnosticArray(header=header(stamp_ns, ''), status=[status])
