"""Motion between scans, and what it says about the size of a range bin."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from bin_size import correlation_length_bins, followed_m, odometry_m
from scan_registration import Motion, Registration, strongest
from scan_sources import recorded_sources

from offradar_ros.types import PolarScan

AZIMUTHS = 400


def seen_from(points_m: np.ndarray, forward_m: float, right_m: float, turn_rad: float) -> PolarScan:
    """A scan of points (N, 2), forward and right of the origin, by a radar at this pose."""
    ahead, aside = (points_m - (forward_m, right_m)).T
    ranges, azimuths = np.hypot(ahead, aside), np.arctan2(aside, ahead) - turn_rad
    power = np.zeros((AZIMUTHS, 120), np.uint8)
    rows = np.round(azimuths / math.tau * AZIMUTHS).astype(int) % AZIMUTHS
    columns = ranges.astype(int)
    seen = columns < power.shape[1]
    power[rows[seen], columns[seen]] = 100
    return PolarScan(0, power, np.linspace(0.0, math.tau, AZIMUTHS, endpoint=False), 1.0)


@pytest.fixture(scope='module')
def points_m() -> np.ndarray:
    return np.random.default_rng(1).uniform(-100.0, 100.0, (150, 2))


@pytest.mark.parametrize('pose', [(0.0, 0.0, 0.0), (12.0, -8.0, 0.5), (-4.0, 10.0, 4.0)])
def test_the_pose_of_a_scan_is_found(points_m: np.ndarray, pose: tuple[float, float, float]) -> None:
    found = Registration(50.0, 2.0).motion(seen_from(points_m, 0.0, 0.0, 0.0), seen_from(points_m, *pose))
    assert found.forward_m == pytest.approx(pose[0], abs=1.6)
    assert found.right_m == pytest.approx(pose[1], abs=1.6)
    assert found.turn_rad % math.tau == pytest.approx(pose[2], abs=0.05)


def test_scans_are_followed_farther_than_one_image_reaches(points_m: np.ndarray) -> None:
    scans = [seen_from(points_m, 6.0 * step, 0.0, 0.3 * step) for step in range(10)]
    found = list(Registration(25.0, 2.0).follow(scans, scans[0]))
    assert found[-1].forward_m == pytest.approx(54.0, abs=6.0)
    assert found[-1].right_m == pytest.approx(0.0, abs=6.0)
    assert found[-1].turn_rad % math.tau == pytest.approx(2.7, abs=0.1)


def test_motions_add_up_in_the_frame_they_lead_to() -> None:
    there = Motion(10.0, 0.0, math.pi / 2, 0.9).then(Motion(5.0, 1.0, 0.1, 0.8))
    assert (there.forward_m, there.right_m) == pytest.approx((9.0, 5.0))
    assert there.score == 0.8


def test_the_strongest_returns_remain() -> None:
    scan = PolarScan(0, np.arange(200, dtype=np.uint8).reshape(10, 20), np.arange(10, dtype=np.float64), 1.0)
    kept = strongest(scan, 0.1).power
    assert (kept > 0).sum() == 20
    assert kept.max() == 199


def test_the_correlation_length_is_that_of_the_returns() -> None:
    rng = np.random.default_rng(2)
    lengths = {}
    for width in (5, 15):
        smooth = np.apply_along_axis(np.convolve, 1, rng.normal(size=(50, 1000)), np.ones(width), 'valid')
        power = np.clip(128.0 + 20.0 * smooth / math.sqrt(width), 0, 255).astype(np.uint8)
        lengths[width] = correlation_length_bins([PolarScan(0, power, np.arange(50, dtype=np.float64), 1.0)])
    # A box of n bins has a triangle of n bins to either side as its autocorrelation.
    assert lengths == pytest.approx({5: 2.5, 15: 7.5}, rel=0.1)


def test_older_navtech_recordings_have_one_correlation_length(real_data: Path) -> None:
    """It is .9 to 1.1 m for four; the two of newer sensors, of one scan each, are longer: no way to find a bin size."""
    lengths_m = {
        name: correlation_length_bins(scans) * scans[0].range_resolution_m
        for name, scans in recorded_sources(real_data, 3)
    }
    older = [lengths_m[name] for name in ('oxford_tiny', 'mulran_kaist03', 'mulran_ray', 'radiate_tiny_foggy')]
    assert older == pytest.approx([1.0] * 4, abs=0.15)
    assert min(lengths_m['utias_frame'], lengths_m['navtech_ros2']) > 1.4


def test_a_known_motion_gives_the_size_of_a_bin(real_data: Path) -> None:
    scans = dict(recorded_sources(real_data, 11))['oxford_tiny']
    driven_m = odometry_m(real_data / 'oxford_tiny' / 'gt' / 'radar_odometry.csv', scans)
    assert driven_m == pytest.approx(19.4, abs=0.1)
    assert followed_m(scans) == pytest.approx(driven_m, rel=0.05)
