from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.encoders.rings import ring_power
from offradar_ros.types import PolarScan


def slow_ring_power(scan: PolarScan, rings: int, max_range_m: float, min_range_m: float) -> np.ndarray:
    """The same by a loop over every bin and every ring, weighted by their overlap."""
    width = max_range_m / rings
    out = np.zeros((len(scan.power), rings))
    for ring in range(rings):
        near, far = max(ring * width, min_range_m), (ring + 1) * width
        for k in range(scan.power.shape[1]):
            start = scan.range_offset_m + k * scan.range_resolution_m
            overlap = max(0.0, min(far, start + scan.range_resolution_m) - max(near, start))
            out[:, ring] += scan.power[:, k] * overlap / width
    return out


@settings(max_examples=60, deadline=None)
@given(
    bins=st.integers(1, 40),
    rings=st.integers(1, 12),
    resolution_m=st.floats(0.04, 5.0),
    offset_m=st.floats(-3.0, 3.0),
    range_m=st.tuples(st.floats(1.0, 60.0), st.floats(0.0, 0.9)),
)
def test_bins_are_weighted_by_their_overlap_with_rings(
    bins: int, rings: int, resolution_m: float, offset_m: float, range_m: tuple[float, float]
) -> None:
    power = np.random.default_rng(bins).integers(0, 256, (3, bins), dtype=np.uint8)
    scan = PolarScan(0, power, np.arange(3.0), resolution_m, offset_m)
    farthest_m, nearest_m = range_m[0], range_m[0] * range_m[1]
    expected = slow_ring_power(scan, rings, farthest_m, nearest_m)
    found = ring_power(scan, rings, farthest_m, nearest_m)
    np.testing.assert_allclose(found, expected, atol=255e-9 * max(1.0, bins))


def test_power_is_conserved() -> None:
    power = np.random.default_rng(0).integers(0, 256, (4, 77), dtype=np.uint8)
    scan = PolarScan(0, power, np.arange(4.0), 0.3)
    rings = ring_power(scan, 10, 40.0, 0.0)
    np.testing.assert_allclose(rings.sum(axis=1) * 4.0, power.sum(axis=1) * 0.3)


def test_beyond_the_sensor_is_zero() -> None:
    scan = PolarScan(0, np.full((2, 10), 200, np.uint8), np.arange(2.0), 1.0)
    rings = ring_power(scan, 8, 16.0, 0.0)
    np.testing.assert_allclose(rings[:, :5], 200.0)
    assert not rings[:, 5:].any()


def test_memory_layout_does_not_matter() -> None:
    power = np.random.default_rng(1).integers(0, 256, (50, 6), dtype=np.uint8)
    one = PolarScan(0, power.T, np.arange(6.0), 0.7)
    two = PolarScan(0, np.ascontiguousarray(power.T), np.arange(6.0), 0.7)
    np.testing.assert_array_equal(ring_power(one, 9, 30.0, 1.0), ring_power(two, 9, 30.0, 1.0))


def test_sums_do_not_overflow() -> None:
    scan = PolarScan(0, np.full((1, 300_000), 255, np.uint8), np.arange(1.0), 0.001)
    assert ring_power(scan, 1, 300.0, 0.0)[0, 0] == pytest.approx(255.0)
