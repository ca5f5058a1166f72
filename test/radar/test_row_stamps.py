"""Row stamps of a clock that nobody set."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.radar.row_stamps import has_unset_rows, with_stamp_of_scan
from offradar_ros.types import PolarScan

NOW = 1_767_225_600 * 10**9


def scan(first_ns: int, stamp_ns: int = NOW, step_ns: int = 625_000) -> PolarScan:
    rows_ns = first_ns + np.arange(400, dtype=np.int64) * step_ns
    return PolarScan(stamp_ns, np.ones((400, 8), np.uint8), np.arange(400) / 400 * 6.28, 0.5, 0.0, rows_ns)


@pytest.mark.parametrize('first_ns', [0, 900 * 10**9, 5 * 10**18, -(10**15)])
def test_rows_outside_this_century_get_the_stamp_of_the_scan(first_ns: int) -> None:
    assert has_unset_rows(scan(first_ns))
    rows_ns = with_stamp_of_scan(scan(first_ns)).azimuth_stamps_ns
    assert rows_ns is not None
    assert rows_ns[0] == NOW
    assert set(np.diff(rows_ns).tolist()) == {625_000}


def test_rows_that_make_no_rotation_all_get_it() -> None:
    rows_ns = with_stamp_of_scan(scan(900, step_ns=10**12)).azimuth_stamps_ns
    assert rows_ns is not None
    assert set(rows_ns.tolist()) == {NOW}


@pytest.mark.parametrize('first_ns', [NOW, NOW - 37 * 10**9, NOW + 86400 * 10**9])
def test_rows_of_another_clock_are_kept(first_ns: int) -> None:
    assert not has_unset_rows(scan(first_ns))


def test_simulated_time_is_no_unset_clock() -> None:
    assert not has_unset_rows(scan(5 * 10**9, stamp_ns=5 * 10**9))
    assert not has_unset_rows(PolarScan(NOW, np.ones((4, 4), np.uint8), np.zeros(4), 0.5))
