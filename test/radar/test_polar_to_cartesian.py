from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.config import CartesianConfig, RadarConfig
from offradar_ros.radar.cartesian import PolarToCartesian
from offradar_ros.radar.image import decode_polar_image
from offradar_ros.radar.png import decode_png
from offradar_ros.radar.spinning import spin
from offradar_ros.types import PolarScan

CONFIG = CartesianConfig()
FINE = 16


def supersampled_rows(scan: PolarScan, config: CartesianConfig, image_rows: range) -> np.ndarray:
    """Mean of 16 × 16 samples in each pixel, interpolated bilinearly between bin centres and azimuths."""
    side, metres = config.side_px, config.resolution_m
    order = np.argsort(scan.azimuths_rad)
    azimuths = scan.azimuths_rad[order]
    around = np.concatenate([[azimuths[-1] - 2 * np.pi], azimuths, [azimuths[0] + 2 * np.pi]])
    power = scan.power[order].astype(np.float64)
    power = np.vstack([power[-1:], power, power[:1]])
    bins = power.shape[1]
    offsets = (np.arange(FINE) + 0.5) / FINE
    right = (np.add.outer(np.arange(side), offsets).ravel() - side / 2) * metres
    means = []
    for i in image_rows:
        total = np.zeros(side)
        for forward in (side / 2 - i - offsets) * metres:
            ranges = np.hypot(forward, right)
            row = np.interp(np.mod(np.arctan2(right, forward), 2 * np.pi), around, np.arange(len(around)))
            at = (ranges - scan.range_offset_m) / scan.range_resolution_m
            seen = (ranges >= config.min_range_m) & (at >= 0) & (at < bins)
            centred = np.clip(at - 0.5, 0, bins - 1)
            r, k = np.minimum(row.astype(int), len(around) - 2), np.minimum(centred.astype(int), bins - 2)
            fr, fk = row - r, centred - k
            near = power[r, k] * (1 - fk) + power[r, k + 1] * fk
            far = power[r + 1, k] * (1 - fk) + power[r + 1, k + 1] * fk
            total += np.where(seen, near * (1 - fr) + far * fr, 0).reshape(side, FINE).mean(axis=1)
        means.append(total / FINE)
    return np.array(means)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(np.asarray(a, float).ravel(), np.asarray(b, float).ravel())[0, 1])


ROWS = range(3, 256, 10)
RECORDED = [
    'oxford_tiny/radar/1547131046353776.png',
    'mulran_kaist03/polar_oxford_form/000000.png',
    'mulran_kaist03/polar/000000.png',
    'radiate_tiny_foggy/Navtech_Polar/000001.png',
    'utias_frame/test_frame.png',
]


@pytest.mark.parametrize('file', RECORDED)
def test_recorded_scans_agree_with_supersampling(real_data: Path, file: str) -> None:
    scan = decode_png(real_data / file, 1, RadarConfig())
    image = PolarToCartesian(CONFIG)(scan)
    assert correlation(image[ROWS], supersampled_rows(scan, CONFIG, ROWS)) >= 0.998


def test_the_live_scan_agrees_with_supersampling(live_image: dict[str, Any]) -> None:
    scan = decode_polar_image(**live_image, config=RadarConfig())
    image = PolarToCartesian(CONFIG)(scan)
    assert correlation(image[ROWS], supersampled_rows(scan, CONFIG, ROWS)) >= 0.998


def smooth_scan(rows: int, bins: int, resolution_m: float, azimuths: np.ndarray | None = None) -> PolarScan:
    """Power that varies over metres and degrees, so that every correct interpolation gives nearly the same image."""
    if azimuths is None:
        azimuths = np.linspace(0.0, 2 * np.pi, rows, endpoint=False)
    ranges = (np.arange(bins) + 0.5) * resolution_m
    wave = 120 + 60 * np.sin(3 * azimuths)[:, np.newaxis] + 60 * np.cos(ranges / 4)[np.newaxis, :]
    return PolarScan(1, np.rint(wave).astype(np.uint8), azimuths, resolution_m)


@pytest.mark.parametrize('resolution_m', [0.0432, 0.0595238, 0.1736, 0.5, 1.3])
@pytest.mark.parametrize('config', [CONFIG, CartesianConfig(side_px=65, resolution_m=1.1, min_range_m=0.0)])
def test_smooth_scans_agree_pixel_by_pixel(resolution_m: float, config: CartesianConfig) -> None:
    scan = smooth_scan(400, round(120 / resolution_m), resolution_m)
    rows = range(1, config.side_px, 9)
    image = PolarToCartesian(config)(scan)[rows].astype(float)
    error = np.abs(image - supersampled_rows(scan, config, rows))
    assert np.percentile(error, 95) < 1.5
    assert error.max() < (40 if config.min_range_m else 8)


def test_range_offset_shifts_the_image_outwards() -> None:
    scan = dataclasses.replace(smooth_scan(400, 1000, 0.1), range_offset_m=3.0)
    rows = range(0, 256, 7)
    error = np.abs(PolarToCartesian(CONFIG)(scan)[rows] - supersampled_rows(scan, CONFIG, rows))
    assert np.percentile(error, 95) < 1.5


@pytest.mark.parametrize(
    'azimuths',
    [
        np.linspace(0.0, 2 * np.pi, 400, endpoint=False)[:399],
        np.linspace(0.0, 2 * np.pi, 400, endpoint=False) + np.random.default_rng(3).uniform(-0.005, 0.005, 400) + 0.006,
        np.mod(3.0 - np.linspace(0.0, 2 * np.pi, 400, endpoint=False), 2 * np.pi),
        np.mod(np.linspace(0.0, 2 * np.pi, 400, endpoint=False) + 5.1, 2 * np.pi),
    ],
    ids=['399 rows', 'jittered', 'counter-clockwise', 'another first azimuth'],
)
def test_irregular_azimuths_agree_with_supersampling(azimuths: np.ndarray) -> None:
    scan = smooth_scan(len(azimuths), 1000, 0.1, azimuths)
    rows = range(2, 256, 11)
    error = np.abs(PolarToCartesian(CONFIG)(scan)[rows] - supersampled_rows(scan, CONFIG, rows))
    assert np.percentile(error, 95) < 1.5


def test_power_of_a_constant_scan_is_kept() -> None:
    scan = dataclasses.replace(smooth_scan(400, 3768, 0.0432), power=np.full((400, 3768), 93, np.uint8))
    image = PolarToCartesian(CONFIG)(scan)
    far = np.add.outer((np.arange(256) - 127.5) ** 2, (np.arange(256) - 127.5) ** 2) > 6**2
    assert set(np.unique(image[far])) == {93}


@pytest.mark.parametrize(
    ('azimuth_deg', 'range_m'), [(0.0, 30.0), (90.0, 30.0), (180.0, 50.0), (270.0, 12.0), (36.0, 44.4), (359.1, 60.0)]
)
def test_a_point_is_in_its_pixel(azimuth_deg: float, range_m: float) -> None:
    power = np.zeros((400, 3768), np.uint8)
    centre_bin = round(range_m / 0.0432 - 0.5)
    power[round(azimuth_deg / 0.9), centre_bin - 3 : centre_bin + 4] = 255
    scan = PolarScan(1, power, np.linspace(0.0, 2 * np.pi, 400, endpoint=False), 0.0432)
    image = PolarToCartesian(CONFIG)(scan).astype(float)
    forward = math.cos(math.radians(azimuth_deg)) * (centre_bin + 0.5) * 0.0432
    right = math.sin(math.radians(azimuth_deg)) * (centre_bin + 0.5) * 0.0432
    i, j = np.average(np.indices(image.shape).reshape(2, -1), axis=1, weights=image.ravel())
    assert i == pytest.approx(128 - forward / 0.5 - 0.5, abs=0.1)
    assert j == pytest.approx(128 + right / 0.5 - 0.5, abs=0.1)


@pytest.mark.parametrize('quarters', [1, 2, 3])
def test_spinning_by_quarter_turns_rotates_the_image(make_scan: Callable[..., PolarScan], quarters: int) -> None:
    scan = make_scan()
    to_cartesian = PolarToCartesian(CONFIG)
    turned = to_cartesian(spin(scan, 100 * quarters)).astype(int)
    # The image turns clockwise, the negative direction of rot90.
    assert np.abs(turned - np.rot90(to_cartesian(scan).astype(int), -quarters)).max() <= 3


def test_spinning_equals_an_azimuth_offset(make_scan: Callable[..., PolarScan]) -> None:
    scan = make_scan()
    offset = dataclasses.replace(scan, azimuths_rad=np.mod(scan.azimuths_rad + 37 * 2 * np.pi / 400, 2 * np.pi))
    apart = PolarToCartesian(CONFIG)(offset).astype(int) - PolarToCartesian(CONFIG)(spin(scan, 37)).astype(int)
    assert np.abs(apart).max() <= 1


def test_near_far_and_unmeasured_are_black() -> None:
    bright = np.full((400, 1000), 200, np.uint8)
    config = CartesianConfig(min_range_m=10.0)
    scan = PolarScan(1, bright, np.linspace(0.0, 2 * np.pi, 400, endpoint=False), 0.05)
    image = PolarToCartesian(config)(scan)
    ranges = np.hypot(*np.meshgrid((np.arange(256) - 127.5) * 0.5, (np.arange(256) - 127.5) * 0.5))
    assert image[ranges < 9.5].max() == 0
    assert image[ranges > 50.5].max() == 0
    assert image[(ranges > 10.5) & (ranges < 49.5)].min() == 200


def test_a_missing_part_of_the_rotation_is_never_filled() -> None:
    azimuths = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)[100:320]
    scan = PolarScan(1, np.full((220, 3000), 200, np.uint8), azimuths, 0.05)
    image = PolarToCartesian(CONFIG)(scan)
    side = np.arange(256) - 127.5
    bearing = np.degrees(np.mod(np.arctan2(side[np.newaxis, :], -side[:, np.newaxis]), 2 * np.pi))
    far = np.hypot(side[np.newaxis, :], side[:, np.newaxis]) > 40
    half_row, pixel = 0.45, 1.1
    missing = (bearing < 90 - half_row - pixel) | (bearing > 319 * 0.9 + half_row + pixel)
    assert image[missing & far].max() == 0
    assert image[~missing & far & (bearing > 92) & (bearing < 285)].min() == 200


@pytest.mark.parametrize('rows', [2, 3, 5])
def test_the_first_rows_of_a_rotation_fill_only_their_sectors(rows: int) -> None:
    azimuths = np.linspace(0.0, 2 * np.pi, 400, endpoint=False)[:rows]
    image = PolarToCartesian(CONFIG)(PolarScan(1, np.full((rows, 3000), 200, np.uint8), azimuths, 0.05))
    assert image[:, :126].max() == 0
    assert image[128:].max() == 0
    assert image[:100, 128].max() == 200


def test_one_missing_row_is_interpolated() -> None:
    azimuths = np.delete(np.linspace(0.0, 2 * np.pi, 400, endpoint=False), 77)
    scan = PolarScan(1, np.full((399, 3000), 200, np.uint8), azimuths, 0.05)
    far = np.add.outer((np.arange(256) - 127.5) ** 2, (np.arange(256) - 127.5) ** 2) > 6**2
    assert PolarToCartesian(CONFIG)(scan)[far].min() == 200


def test_images_do_not_depend_on_the_scan_before(make_scan: Callable[..., PolarScan]) -> None:
    kept = PolarToCartesian(CONFIG)
    for scan in (
        make_scan(),
        make_scan(bins=3000, resolution_m=0.04),
        make_scan(rows=399),
        make_scan(),
        make_scan(5, 9),
    ):
        assert np.array_equal(kept(scan), PolarToCartesian(CONFIG)(scan))
