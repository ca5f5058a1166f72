"""Scans that are damaged, of another sensor, empty or noise: the pose is right, or the score is low."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plane import STAMP_NS, Plane, make_plane

from offradar_ros.alignment.align import align, prepare_place, prepare_query
from offradar_ros.alignment.signature import BRIGHTEST, Signature, SignatureConfig, SignatureMaker
from offradar_ros.alignment.twist import Twist
from offradar_ros.config import PolarGridConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.types import Alignment, PolarScan

PLANE = make_plane(1)
MAKE = SignatureMaker()
LEAST_SCORE = 0.3
"""Right alignments of these scans reach more, ..."""
MOST_SCORE = 0.3
"""... and what shows nothing of the place less."""


def aligned(place: PolarScan, query: PolarScan) -> Alignment:
    return align(prepare_place(MAKE(place)), prepare_query(MAKE(query)))


def assert_near(found: Alignment, pose: tuple[float, float, float], metres: float = 0.2, degrees: float = 0.4) -> None:
    off = found.pose - np.array(pose)
    assert np.hypot(off[0], off[1]) < metres
    assert abs(math.degrees(math.remainder(off[2], 2.0 * math.pi))) < degrees
    assert found.score > LEAST_SCORE


def only(scan: PolarScan, rows: np.ndarray) -> PolarScan:
    assert scan.azimuth_stamps_ns is not None
    return dataclasses.replace(
        scan,
        power=scan.power[rows],
        azimuths_rad=scan.azimuths_rad[rows],
        azimuth_stamps_ns=scan.azimuth_stamps_ns[rows],
    )


def silent(scan: PolarScan, rows: np.ndarray) -> PolarScan:
    scan.power[~rows] = 0
    return scan


def blocked(scan: PolarScan, rows: np.ndarray) -> PolarScan:
    """By a lorry 5 m away: bright there, and noise behind it."""
    scan.power[~rows, 18:24] = 200
    noise = np.random.default_rng(3).normal(30.0, 3.0, (400, 376))
    scan.power[~rows, 24:] = noise[~rows].astype(np.uint8)
    return scan


HALF = np.arange(400) < 200
SCATTERED = np.random.default_rng(7).random(50).repeat(8) < 0.5


@pytest.mark.parametrize('yaw_deg', [3.0, -100.0, 178.0])
@pytest.mark.parametrize('rows', [HALF, np.roll(HALF, 130), SCATTERED], ids=['half', 'other half', 'scattered'])
@pytest.mark.parametrize('fault', [only, silent, blocked])
def test_half_of_the_sectors_are_enough(
    fault: Callable[[PolarScan, np.ndarray], PolarScan], rows: np.ndarray, yaw_deg: float
) -> None:
    pose = (2.0, -1.5, math.radians(yaw_deg))
    # A lorry is there for one of the scans alone, and brighter than all else.
    metres = 0.5 if fault is blocked else 0.3
    assert_near(aligned(PLANE.scan(), fault(PLANE.scan(pose, seed=1), rows)), pose, metres)
    back = aligned(fault(PLANE.scan(pose, seed=1), rows), PLANE.scan())
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    assert_near(back, (-cos * pose[0] - sin * pose[1], sin * pose[0] - cos * pose[1], -pose[2]), metres)


# As those of Oxford, MulRan and RADIATE: rows, bins, metres of a bin, metres of the first bin's near edge.
SENSORS = {
    'oxford': (400, 2100, 0.0432, 0.0),
    'mulran': (400, 1500, 0.0595, 0.0),
    'radiate': (400, 576, 0.1736, 0.0),
    'offset': (400, 576, 0.1736, -0.5),
    'few rows': (200, 300, 0.3, 0.2),
}


@pytest.mark.parametrize('sensor', SENSORS)
def test_a_map_of_another_sensor_fits(sensor: str) -> None:
    azimuths, range_bins, range_resolution_m, range_offset_m = SENSORS[sensor]
    pose = (-3.0, 2.0, math.radians(170.0))
    query = PLANE.scan(
        pose,
        azimuths=azimuths,
        range_bins=range_bins,
        range_resolution_m=range_resolution_m,
        range_offset_m=range_offset_m,
        seed=1,
    )
    assert_near(aligned(PLANE.scan(), query), pose)


def test_two_identical_scans_lie_on_one_another() -> None:
    found = aligned(PLANE.scan(), PLANE.scan())
    np.testing.assert_allclose(found.pose, 0.0, atol=1e-3)
    assert found.score > 0.9


def noise(seed: int, spread: float) -> PolarScan:
    power = np.random.default_rng(seed).normal(60.0, spread, (400, 400))
    return dataclasses.replace(PLANE.scan(), power=np.clip(power, 0.0, 255.0).astype(np.uint8))


NOTHING = Plane(np.empty((0, 2)), np.empty(0)).scan(seed=2)
USELESS = {
    'empty': dataclasses.replace(NOTHING, power=np.zeros_like(NOTHING.power)),
    'no returns': NOTHING,
    'saturated': dataclasses.replace(NOTHING, power=np.full_like(NOTHING.power, 255)),
    'quiet noise': noise(1, 8.0),
    'loud noise': noise(2, 40.0),
    'one row': only(PLANE.scan(), np.arange(400) == 17),
    'one bin': PolarScan(STAMP_NS, np.full((400, 1), 90, np.uint8), PLANE.scan().azimuths_rad, 0.25),
}


@pytest.mark.parametrize('other', [None, *USELESS])
@pytest.mark.parametrize('useless', USELESS)
def test_a_scan_that_shows_nothing_agrees_with_nothing(useless: str, other: str | None) -> None:
    second = PLANE.scan(seed=1) if other is None else USELESS[other]
    if other == useless:
        return
    for found in (aligned(USELESS[useless], second), aligned(second, USELESS[useless])):
        assert np.isfinite(found.pose).all()
        assert np.all(np.linalg.eigvalsh(found.covariance) > 0.0)
        assert found.score < MOST_SCORE


def test_where_nothing_agrees_the_pose_is_unknown() -> None:
    found = aligned(NOTHING, PLANE.scan())
    assert found.score == 0.0
    assert found.pose.tolist() == [0.0, 0.0, 0.0]
    assert np.sqrt(np.diag(found.covariance)).tolist() == pytest.approx([20.0, 20.0, math.pi])


@settings(max_examples=40)
@given(
    shape=st.sampled_from([(8, 8), (8, 160), (9, 11), (100, 160), (720, 8), (200, 80)]),
    resolution_m=st.sampled_from([0.1, 1.0, 10.0]),
    levels=st.integers(0, BRIGHTEST),
    seen=st.floats(0.0, 1.0),
    twist=st.builds(Twist, *[st.floats(-100.0, 100.0)] * 3),
    turn_s=st.floats(-10.0, 10.0),
    seed=st.integers(0, 99),
)
def test_any_two_signatures_have_a_finite_alignment(
    shape: tuple[int, int], resolution_m: float, levels: int, seen: float, twist: Twist, turn_s: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    config = SignatureConfig(PolarGridConfig(*shape, resolution_m=resolution_m, min_range_m=0.2))
    place, query = (
        Signature(rng.integers(0, levels + 1, shape, np.uint8), rng.random(shape[0]) < seen, 0.1, turn_s, config=config)
        for _ in range(2)
    )
    found = align(prepare_place(place, twist), prepare_query(query, twist))
    assert np.isfinite(found.pose).all()
    assert np.isfinite(found.covariance).all()
    assert -1.0 <= found.score <= 1.0


def test_signatures_of_other_settings_are_not_compared() -> None:
    coarser = SignatureMaker(SignatureConfig(PolarGridConfig(100, 80, 1.0, 4.0)))(PLANE.scan())
    with pytest.raises(RefusedInput, match='expected the same') as refused:
        align(prepare_place(MAKE(PLANE.scan())), prepare_query(coarser))
    assert refused.value.cause == 'unlike_signatures'
