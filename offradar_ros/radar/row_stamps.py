"""Stamps of a scan's rows as stored to nanoseconds: their unit, and which of them are wrong."""

from __future__ import annotations

import bisect
import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.positions.rules import END_NS, YEAR_2000_NS
from offradar_ros.radar.encoder_counts import LARGEST_SHARE_MENDED, at_every_row

LONGEST_ROTATION_NS = 60 * 10**9
_UNITS_NS = (1, 1000)
_SLACK_NS = 1_000_000.0


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class RowStamps:
    """Stamps of a scan's rows.

    Attributes:
        stamps_ns: (A,) int64, or None if the rows have no usable stamps.
        mended: number of rows whose stamp contradicts the others: it is interpolated.
    """

    stamps_ns: NDArray[np.int64] | None
    mended: int = 0


def unit_ns(stamps: NDArray[np.int64], scan_stamp_ns: int | None) -> int | None:
    """Nanoseconds of the unit of stored stamps, 1 or 1000; None if most of them are of a clock that was never set.

    The stamp of the scan tells first, as it may be of any clock; then the years from 2000 to 2038.
    """
    median = int(np.sort(stamps)[len(stamps) // 2])
    if scan_stamp_ns is not None:
        nearest = min(_UNITS_NS, key=lambda unit: abs(median * unit - scan_stamp_ns))
        if abs(median * nearest - scan_stamp_ns) < LONGEST_ROTATION_NS:
            return nearest
    for unit in _UNITS_NS:
        if YEAR_2000_NS < median * unit < END_NS:
            return unit
    return None


def sound_stamps(
    stamps: NDArray[np.int64], written: NDArray[np.bool_], scan_stamp_ns: int | None, lost: int = 0
) -> RowStamps:
    """Stamps of (A,) rows in ns; those of rows that have none (not `written`) or a wrong one are interpolated.

    `lost` is how many of the rows without a stamp were measured all the same.

    A stamp is wrong if it is a rotation or more away from most others, or not in their order. None are returned if
    the clock was never set, or is set during the scan, or over `LARGEST_SHARE_MENDED` of the stamps are wrong.
    """
    rows = np.flatnonzero(written)
    unit = unit_ns(stamps[rows], scan_stamp_ns) if len(rows) else None
    if unit is None:
        return RowStamps(None)
    # As floats: the difference of two damaged stamps may not fit into 64 bits, that of near ones does.
    reference = int(np.sort(stamps[rows])[len(rows) // 2])
    offset = stamps[rows].astype(np.float64) - float(reference)
    usual = 4.0 * float(np.median(np.abs(offset))) + _SLACK_NS / unit
    near = np.abs(offset) <= min(usual, LONGEST_ROTATION_NS / unit)
    exact = stamps[rows[near]] - reference
    in_order = np.zeros(len(rows), np.bool_)
    in_order[np.flatnonzero(near)[_longest_increasing(exact)]] = True
    mended = len(rows) - int(np.count_nonzero(in_order)) + lost
    if mended > max(1.0, LARGEST_SHARE_MENDED * (len(rows) + lost)):
        return RowStamps(None)
    kept = rows[in_order]
    first = int(stamps[kept[0]])
    if (int(stamps[kept[-1]]) - first) * unit > LONGEST_ROTATION_NS:
        # As if the clock had been set during the rotation.
        return RowStamps(None)
    after = (stamps[kept] - first).astype(np.float64)
    step = float(np.median(np.diff(after) / np.diff(kept))) if len(kept) > 1 else 0.0
    every = np.rint(at_every_row(kept, after, step, len(stamps))).astype(np.int64)
    return RowStamps((every + first) * unit, mended)


def _longest_increasing(values: NDArray[np.int64]) -> list[int]:
    """Indices of the longest subsequence that never decreases."""
    if np.all(np.diff(values) >= 0):
        return list(range(len(values)))
    ends: list[int] = []
    last: list[int] = []
    before = [-1] * len(values)
    for index, value in enumerate(values.tolist()):
        length = bisect.bisect_right(ends, value)
        before[index] = last[length - 1] if length else -1
        ends[length : length + 1] = [value]
        last[length : length + 1] = [index]
    chain: list[int] = []
    at = last[-1] if last else -1
    while at >= 0:
        chain.append(at)
        at = before[at]
    return chain[::-1]
