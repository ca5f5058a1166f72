"""What became of every message of an input, so that none is lost without a trace."""

from __future__ import annotations

import threading
from collections import Counter


class Ledger:
    """Counts the messages of one input that arrived, and how each one ended.

    At any time: received = the sum of the ends + waiting, where those wait that have not ended; and, since the first
    message of each publisher that arrived, sent = received + lost_before_arrival. May be used by several threads.

    Args:
        name: of the messages, in the report.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._lock = threading.Lock()
        self._received = self._lost = 0
        self._ends: Counter[str] = Counter()

    def receive(self) -> None:
        """One message arrived."""
        with self._lock:
            self._received += 1

    def settle(self, end: str) -> None:
        """One message that arrived has ended as `end`."""
        with self._lock:
            self._ends[end] += 1

    def lose(self, count: int) -> None:
        """`count` messages were sent, and did not arrive."""
        with self._lock:
            self._lost += count

    @property
    def received(self) -> int:
        """Number of messages that arrived."""
        return self._received

    @property
    def lost(self) -> int:
        """Number of messages that were sent, and did not arrive."""
        return self._lost

    @property
    def ends(self) -> dict[str, int]:
        """Number of messages by how they ended."""
        with self._lock:
            return dict(self._ends)

    def values(self) -> dict[str, str]:
        """As key and value of a report."""
        with self._lock:
            counts = {'received': self._received, **dict(sorted(self._ends.items())), 'lost_before_arrival': self._lost}
            counts['waiting'] = self._received - self._ends.total()
        return {f'{self.name}.{key}': str(count) for key, count in counts.items()}
