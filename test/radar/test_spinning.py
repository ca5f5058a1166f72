from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from offradar_ros.radar.spinning import spin
from offradar_ros.types import PolarScan


@pytest.mark.parametrize('rows', [0, 1, 7, 100, 399, 400, -3])
def test_power_and_row_stamps_move_together(make_scan: Callable[..., PolarScan], rows: int) -> None:
    scan = dataclasses.replace(make_scan(bins=20), azimuth_stamps_ns=np.arange(400, dtype=np.int64))
    turned = spin(scan, rows)
    assert turned.azimuth_stamps_ns is not None
    for k in range(400):
        assert np.array_equal(turned.power[(k + rows) % 400], scan.power[k])
        assert turned.azimuth_stamps_ns[(k + rows) % 400] == k
    assert np.array_equal(turned.azimuths_rad, scan.azimuths_rad)


def test_spinning_back_gives_the_same_scan(make_scan: Callable[..., PolarScan]) -> None:
    scan = make_scan(bins=20)
    back = spin(spin(scan, 123), -123)
    assert np.array_equal(back.power, scan.power)
    assert back.azimuth_stamps_ns is None
