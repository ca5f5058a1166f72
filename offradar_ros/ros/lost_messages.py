"""Messages that were sent and never arrived, as the numbers of those that did arrive show.

A subscription keeps its newest messages and drops the others before anybody sees them, and Fast DDS does not report
that as a loss. But each publisher numbers its messages, and the number comes with the message.
"""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

_KEPT_PERIODS = 32
_FEWEST_PERIODS = 4
# A longer pause is taken for one of the sensor.
_LONGEST_GAP_NS = 10 * 10**9


class LostMessages:
    """Counts the gaps in what arrives on one topic.

    What a publisher sent before the first message of it that arrives is not counted: the subscription may have come
    later. With several publishers on a topic, whose messages do not name them, each number continues the numbers that
    it fits best; the sum is right as soon as each of them has been heard again.

    Args:
        publishers: returns how many publishers the topic has now.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self._publishers = publishers
        # The last number of each publisher, the one that sent last at the end.
        self._last: list[int] = []
        self._stamp_ns: int | None = None
        self._periods_ns: deque[int] = deque(maxlen=_KEPT_PERIODS)

    def arrived(self, info: Mapping[str, Any], stamp_ns: int | None = None) -> int:
        """How many messages were lost just before this one.

        `info` is rclpy's, with the publisher's number of the message. Where the middleware has no numbers, the result
        is an estimate from `stamp_ns`, the stamp of the header: how many of the usual periods are missing.
        """
        number = info.get('publication_sequence_number')
        return self._by_stamp(stamp_ns) if number is None else self._by_number(int(number))

    def _by_number(self, number: int) -> int:
        before = max((last for last in self._last if last < number), default=None)
        if before is None or (number > before + 1 and len(self._last) < self._publishers()):
            # A publisher that is new, was started again, or has not been heard before.
            del self._last[: max(0, len(self._last) + 1 - max(1, self._publishers()))]
            self._last.append(number)
            return 0
        self._last.remove(before)
        self._last.append(number)
        return number - before - 1

    def _by_stamp(self, stamp_ns: int | None) -> int:
        before, self._stamp_ns = self._stamp_ns, stamp_ns
        if before is None or stamp_ns is None or not 0 < stamp_ns - before <= _LONGEST_GAP_NS:
            return 0
        usual_ns = statistics.median(self._periods_ns) if len(self._periods_ns) >= _FEWEST_PERIODS else None
        self._periods_ns.append(stamp_ns - before)
        return 0 if usual_ns is None else max(0, round((stamp_ns - before) / usual_ns) - 1)
