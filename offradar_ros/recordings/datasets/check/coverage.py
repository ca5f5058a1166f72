"""Whether positions cover the scans, and by how much their clocks differ if not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig
from offradar_ros.geometry import Trajectory
from offradar_ros.positions.clocks import known_offset
from offradar_ros.recordings.datasets.check.findings import Finding, ok, problem
from offradar_ros.recordings.datasets.coverage import seconds_apart, span_ns

LARGEST_OFFSET_S = 1e9
"""A larger difference is no offset between clocks: one of them does not give the time."""

_STEP_NS = 10**8
_DAY_S = 24 * 3600.0


def coverage(
    name: str,
    stamps_ns: NDArray[np.int64],
    trajectory: Trajectory,
    position: PositionConfig,
    offset_s: float = 0.0,
    in_time: int | None = None,
) -> Finding:
    """How many of the scans at (N,) int64 `stamps_ns`, N > 0, have a position of the trajectory that `name` names.

    Stamps are in any order.
    `offset_s` is what was already added to the trajectory's stamps: the offset that is proposed includes it.
    `in_time` is how many of the scans get their position within `position.wait_s`, where that is known.
    """
    if not len(trajectory):
        return problem(f'{name}: no scan has a position: it holds none that is usable')
    count = int(np.count_nonzero(trajectory.covers(stamps_ns, round(position.max_gap_s * 1e9))))
    apart_s = seconds_apart(stamps_ns, trajectory)
    if apart_s and not count:
        early = trajectory.stamps_ns[-1] < span_ns(stamps_ns)[0]
        where = 'end {} before the first scan' if early else 'start {} after the last scan'
        text = f'{name}: no scan has a position: positions {where.format(duration(apart_s))}'
        found_s, why = _offset_s(stamps_ns, trajectory)
        remedy_s = offset_s + found_s
        if abs(remedy_s) <= LARGEST_OFFSET_S:
            text += f' (if the clocks disagree{why}: offradar convert --position-offset-s {remedy_s:.1f})'
        return problem(text)
    text = f'{name}: {count} of {len(stamps_ns)} scans have a position (gaps up to {position.max_gap_s:g} s)'
    if in_time is not None and in_time < count:
        return problem(
            f'{text}, but only {in_time} while they wait, for position.wait_s ({position.wait_s:g} s): those of the '
            'others arrive later'
        )
    return ok(text) if count == len(stamps_ns) else problem(text)


def duration(seconds: float) -> str:
    """Seconds, or days where it is more than one."""
    return f'{seconds:.1f} s' if seconds < _DAY_S else f'{seconds / _DAY_S:.1f} days'


def _offset_s(stamps_ns: NDArray[np.int64], trajectory: Trajectory) -> tuple[float, str]:
    """Seconds to add to the positions, and why so many.

    Where a usual offset makes the positions cover the scans, as far as they can, it is that; else the first position is
    brought to the first scan, or less than 0.1 s before it.
    """
    first_scan_ns, last_scan_ns = span_ns(stamps_ns)
    first_ns, last_ns = first_scan_ns - int(trajectory.stamps_ns[0]), last_scan_ns - int(trajectory.stamps_ns[-1])
    usual = known_offset(min(first_ns, last_ns) / 1e9, max(first_ns, last_ns) / 1e9)
    if usual is not None:
        return usual[0], f', {usual[1]}'
    return first_ns // _STEP_NS * _STEP_NS / 1e9, ''
