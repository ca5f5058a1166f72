"""Scans that are repeated, and scans without any signal."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.image import decode_polar_image
from offradar_ros.radar.repeated_power import RepeatedPower
from offradar_ros.types import PolarScan


def decoded(power: np.ndarray) -> PolarScan:
    height, width = power.shape
    config = RadarConfig(range_resolution_m=0.175)
    return decode_polar_image(
        power.tobytes(), height=height, width=width, step=width, encoding='mono8', stamp_ns=10**18, config=config
    )


def test_a_scan_is_repeated_if_all_its_power_is_that_of_the_one_before() -> None:
    power = np.random.default_rng(0).integers(1, 200, (400, 576), np.uint8)
    first, other = decoded(power), power.copy()
    other[7, 9] += 1
    repeated = RepeatedPower()
    later = dataclasses.replace(first, stamp_ns=first.stamp_ns + 1)
    assert [repeated.is_repeated(s) for s in (first, later, decoded(other), first)] == [False, True, False, False]


@pytest.mark.parametrize('value', [0, 1, 128, 255])
def test_power_that_is_the_same_everywhere_is_no_signal(value: int) -> None:
    power = np.full((400, 576), value, np.uint8)
    with pytest.raises(RefusedInput) as refused:
        decoded(power)
    assert refused.value.cause == 'no_signal'
    power[:100, 575] = value ^ 1
    assert decoded(power).power[99, 575] == value ^ 1
