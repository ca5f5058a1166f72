"""Messages that were sent and never arrived, as the numbers of those that did arrive show.

A subscription keeps its newest messages and drops the others before anybody sees them, and Fast DDS does not report
that as a loss. But each publisher numbers its messages, and the number comes with the message.
"""

from __future__ import annotations

import dataclasses
import statistics
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

_KEPT_PERIODS = 32
_FEWEST_PERIODS = 4
# A longer pause is taken for one of the sensor.
_LONGEST_GAP_NS = 10 * 10**9
DOUBTED = 16
"""So many messages after a gap, it counts, although a publisher that was not heard before could explain it."""


@dataclasses.dataclass
class _Doubt:
    """A gap, unless what came after it is of another publisher: then the one before it goes on."""

    before: int
    lost: int
    messages: int = 0


class LostMessages:
    """Counts the gaps in what arrives on one topic.

    What a publisher sent before the first message of it that arrives is not counted: the subscription may have come
    later. With several publishers on a topic, whose messages do not name them, each number continues the numbers that
    it fits best; the sum is right as soon as each of them has been heard again. The first number of a publisher looks
    like a gap in those of another: while one has not been heard, a gap counts `DOUBTED` messages later.

    Args:
        publishers: returns how many publishers of the topic can be heard now.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self._publishers = publishers
        # The last number of each publisher, the one that sent last at the end.
        self._last: list[int] = []
        self._doubts: list[_Doubt] = []
        self._stamp_ns: int | None = None
        self._periods_ns: deque[int] = deque(maxlen=_KEPT_PERIODS)

    def arrived(self, info: Mapping[str, Any], stamp_ns: int | None = None) -> int:
        """How many messages were lost, as this one shows.

        `info` is rclpy's, with the publisher's number of the message. Where the middleware has no numbers, the result
        is an estimate from `stamp_ns`, the stamp of the header: how many of the usual periods are missing.
        """
        number = info.get('publication_sequence_number')
        return self._by_stamp(stamp_ns) if number is None else self._by_number(int(number))

    def _by_number(self, number: int) -> int:
        known = [*self._last, *(doubt.before for doubt in self._doubts)]
        before = max((last for last in known if last < number), default=None)
        if before in self._last:
            self._last.remove(before)
        else:
            self._doubts = [doubt for doubt in self._doubts if doubt.before != before]
        self._last.append(number)
        lost = 0 if before is None else number - before - 1
        if lost or len(self._last) > 1:
            publishers = max(1, self._publishers())
            # Those that have ended, or were started again with new numbers.
            del self._last[:-publishers]
            if before is not None and lost and len(self._last) < publishers:
                self._doubts.append(_Doubt(before, lost))
                lost = 0
        return lost + self._no_longer_doubted()

    def _no_longer_doubted(self) -> int:
        for doubt in self._doubts:
            doubt.messages += 1
        lost = sum(doubt.lost for doubt in self._doubts if doubt.messages >= DOUBTED)
        self._doubts = [doubt for doubt in self._doubts if doubt.messages < DOUBTED]
        return lost

    def _by_stamp(self, stamp_ns: int | None) -> int:
        before, self._stamp_ns = self._stamp_ns, stamp_ns
        if before is None or stamp_ns is None or not 0 < stamp_ns - before <= _LONGEST_GAP_NS:
            return 0
        usual_ns = statistics.median(self._periods_ns) if len(self._periods_ns) >= _FEWEST_PERIODS else None
        self._periods_ns.append(stamp_ns - before)
        return 0 if usual_ns is None else max(0, round((stamp_ns - before) / usual_ns) - 1)
