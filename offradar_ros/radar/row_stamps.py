"""Stamps of a scan's rows that are no time: the radar's clock was never set and counts from 1970 or from its start."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.positions.rules import YEAR_2000_NS, YEAR_2100_NS
from offradar_ros.types import PolarScan

_LONGEST_ROTATION_NS = 60 * 10**9


def has_unset_rows(scan: PolarScan) -> bool:
    """Whether row stamps are outside the years 2000 to 2100 while that of the scan is inside."""
    stamps_ns = scan.azimuth_stamps_ns
    if stamps_ns is None or not YEAR_2000_NS <= scan.stamp_ns < YEAR_2100_NS:
        return False
    return bool(stamps_ns.min() < YEAR_2000_NS or stamps_ns.max() >= YEAR_2100_NS)


def with_stamp_of_scan(scan: PolarScan) -> PolarScan:
    """The scan with the stamps of its rows moved so that the first is its own; all are if they make no rotation."""
    stamps_ns = scan.azimuth_stamps_ns
    if stamps_ns is None:
        return scan
    since_ns = stamps_ns.astype(np.float64) - float(stamps_ns[0])
    plausible = np.all(np.diff(since_ns) >= 0.0) and since_ns[-1] < _LONGEST_ROTATION_NS
    moved = stamps_ns - stamps_ns[0] if plausible else np.zeros_like(stamps_ns)
    return dataclasses.replace(scan, azimuth_stamps_ns=scan.stamp_ns + moved)
