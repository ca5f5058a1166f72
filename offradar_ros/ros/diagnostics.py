"""Rates, latencies, drops and troubles of one node, once a second on /diagnostics."""

from __future__ import annotations

import collections
import dataclasses
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from offradar_ros.ros.stamps import header

WINDOW = 256
MAX_REASON = 300
"""Longest text of a reason in a report, in characters."""


@dataclasses.dataclass(frozen=True)
class Trouble:
    """Why a node does not do what it is there for.

    Attributes:
        cause: a short, stable name, such as ``no_scans``.
        text: what is the matter, and what to do.
        is_error: whether nothing comes of the node's work (ERROR), or something may (WARN).
    """

    cause: str
    text: str
    is_error: bool = False


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
        self._reasons: dict[str, tuple[float, str]] = {}
        self._latencies_s: collections.deque[float] = collections.deque(maxlen=WINDOW)
        self._last_report_s = clock()
        self._last_handled = 0
        self._last_drops: Counter[str] = Counter()
        self._lock = threading.Lock()

    def handle(self, received_s: float) -> None:
        """One message handled, received at `received_s` of the steady clock."""
        with self._lock:
            self.handled += 1
            self._latencies_s.append(self._clock() - received_s)

    def drop(self, cause: str, reason: str = '', count: int = 1) -> None:
        """One message dropped, or `count` of them, and why."""
        with self._lock:
            self.drops[cause] += count
            self._reasons[cause] = self._clock(), reason

    def recent_reason(self, cause: str, within_s: float) -> str | None:
        """The reason of the last drop of this cause, if it was at most `within_s` ago."""
        with self._lock:
            dropped_s, reason = self._reasons.get(cause, (-np.inf, ''))
            return reason if self._clock() - dropped_s <= within_s else None

    def message(self, stamp_ns: int, troubles: Sequence[Trouble] = ()) -> DiagnosticArray:
        """Report, and start the next period; WARN if anything was dropped in this one, ERROR for a trouble that is."""
        with self._lock:
            return self._message(stamp_ns, troubles)

    def _message(self, stamp_ns: int, troubles: Sequence[Trouble]) -> DiagnosticArray:
        now_s = self._clock()
        rate_hz = (self.handled - self._last_handled) / max(now_s - self._last_report_s, 1e-9)
        new_drops = self.drops - self._last_drops
        self._last_report_s, self._last_handled = now_s, self.handled
        self._last_drops = Counter(self.drops)
        values = {'handled': str(self.handled), 'rate_hz': f'{rate_hz:.2f}', 'dropped': str(self.drops.total())}
        if self._latencies_s:
            p50, p99 = np.percentile(np.fromiter(self._latencies_s, np.float64), [50, 99]) * 1e3
            values |= {'latency_p50_ms': f'{p50:.2f}', 'latency_p99_ms': f'{p99:.2f}'}
        values |= {f'dropped.{cause}': str(count) for cause, count in sorted(self.drops.items())}
        values |= {name: str(count) for name, count in sorted(self.counts.items())} | self.facts
        values |= {f'trouble.{trouble.cause}': trouble.text for trouble in troubles}
        worst_first = sorted(troubles, key=lambda trouble: not trouble.is_error)
        texts = [trouble.text for trouble in worst_first]
        if self.warning:
            texts.append(self.warning)
        if new_drops:
            texts.insert(sum(trouble.is_error for trouble in troubles), self._describe(new_drops))
        level = DiagnosticStatus.WARN if texts else DiagnosticStatus.OK
        status = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if any(trouble.is_error for trouble in troubles) else level,
            name=self._name,
            message='; '.join(texts) or f'{rate_hz:.1f} Hz',
            hardware_id='offradar_ros',
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        return DiagnosticArray(header=header(stamp_ns, ''), status=[status])

    def _describe(self, drops: Counter[str]) -> str:
        cause, _ = drops.most_common(1)[0]
        _, reason = self._reasons.get(cause, (0.0, ''))
        # The last line of a traceback is the error.
        lines = reason.strip().splitlines() or ['']
        shown = lines[-1] if cause == 'internal_error' else lines[0]
        mostly = f', mostly {cause}' if len(drops) > 1 else f' ({cause})'
        return f'{drops.total()} dropped in the last period{mostly}{f": {shown[:MAX_REASON]}" if shown else ""}'
