"""Whether the clocks of radar and positions agree, from when their messages arrive.

A stamp that is right lies a little before the arrival, by the latency. Where the two kinds of stamps lie differently
far before it, by more than latencies differ, one clock is wrong.
"""

from __future__ import annotations

import collections
import statistics

OFFSET_S = 1.0
"""Clocks that seem to disagree by less than this may differ by the latencies of their messages alone."""
_WINDOW = 256
_FEWEST = 10
_TOGETHER_NS = 2 * 10**9
_CONSISTENT = 0.8
_SPREAD_S = 0.5
_NEAR_S = 0.75
_NAMES = {
    37.0: 'TAI is 37 s ahead of UTC',
    18.0: 'GPS time is 18 s ahead of UTC',
    19.0: 'TAI is 19 s ahead of GPS time',
    1024 * 7 * 86400.0: 'a GPS week number that has rolled over: 1024 weeks',
    315_964_800.0 - 18.0: 'GPS time counts from 1980, and is 18 s ahead of UTC',
    315_964_800.0: 'GPS time counts from 1980',
} | {half_hours * 1800.0: 'as time zones do' for half_hours in range(1, 29)}
_KNOWN = [(sign * s, name) for s, name in _NAMES.items() for sign in (1.0, -1.0)]
"""Offsets that clocks have, in s, and why."""


class ArrivalClocks:
    """Compares arrivals and stamps over the last messages. Arrivals may be of any clock that runs steadily."""

    def __init__(self) -> None:
        self._position: tuple[int, int] | None = None
        self._differences_s: collections.deque[float] = collections.deque(maxlen=_WINDOW)

    def add_position(self, arrival_ns: int, stamp_ns: int) -> None:
        """A position arrived."""
        self._position = arrival_ns, arrival_ns - stamp_ns

    def add_scan(self, arrival_ns: int, stamp_ns: int) -> None:
        """A scan, or what was made of it, arrived. It is compared with the position that arrived last."""
        if self._position is not None and abs(arrival_ns - self._position[0]) <= _TOGETHER_NS:
            self._differences_s.append((self._position[1] - (arrival_ns - stamp_ns)) / 1e9)

    def offset_s(self) -> float | None:
        """Seconds to add to positions' stamps so that they lie as far before their arrival as the scans' do.

        None with too few messages, or where the differences vary, as when a recording is stopped and resumed.
        """
        if len(self._differences_s) < _FEWEST:
            return None
        offset_s = statistics.median(self._differences_s)
        near = sum(abs(difference_s - offset_s) <= _SPREAD_S for difference_s in self._differences_s)
        return offset_s if near >= _CONSISTENT * len(self._differences_s) else None


def clock_problem(
    offset_s: float | None, least_s: float = OFFSET_S, evidence: str = 'their arrival', given_s: float = 0.0
) -> str:
    """What is wrong with the clocks, and the option that corrects a recording; empty below `least_s`, or if unknown.

    `given_s` was already added to positions' stamps: the proposed option includes it.
    """
    if offset_s is None or abs(offset_s) < least_s:
        return ''
    exact_s, why = _explained(offset_s)
    return (
        f'the clocks of radar and positions disagree by {abs(offset_s):.1f} s, says {evidence}{why}: set both to one '
        f'clock; a recording is corrected by offradar convert --position-offset-s {given_s + exact_s:.1f}'
    )


def known_offset(lowest_s: float, highest_s: float) -> tuple[float, str] | None:
    """The one usual offset between two clocks within these bounds, and its name; None if there is none, or several."""
    found = [(s, name) for s, name in _KNOWN if lowest_s <= s <= highest_s]
    return found[0] if len(found) == 1 else None


def _explained(offset_s: float) -> tuple[float, str]:
    """The offset that was meant, where it is a known one, and its name."""
    nearest_s, name = min(_KNOWN, key=lambda known: abs(known[0] - offset_s))
    return (nearest_s, f' ({name})') if abs(nearest_s - offset_s) <= _NEAR_S else (offset_s, '')
