"""The polar image against loops over cells, bins and rows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.config import PolarGridConfig, RadarConfig
from offradar_ros.radar.png import decode_png
from offradar_ros.radar.polar_grid import PolarToGrid, sector_weights
from offradar_ros.radar.spinning import spin
from offradar_ros.types import PolarScan

CONFIG = PolarGridConfig()
SMALL = PolarGridConfig(azimuths=24, range_bins=16, resolution_m=4.0, min_range_m=0.0)
# Finer and coarser sensors, as (range bins, metres for each bin).
SENSORS = [(3768, 0.0432), (3360, 0.0595), (576, 0.1736), (256, 0.25)]
STEP = 2 * math.pi / 400
SAMPLES = 600


def rows_of_sectors(azimuths_rad: np.ndarray, sectors: int) -> np.ndarray:
    """(sectors, rows) share of each row, found by the nearest row of `SAMPLES` directions in each sector."""
    rows = len(azimuths_rad)
    away = [sorted(math.remainder(b - a, math.tau) for b in azimuths_rad) for a in azimuths_rad]
    after = sorted(min((d for d in others if d > 1e-9), default=math.tau) for others in away)
    typical = float(np.median(after[: max(1, rows - 1)]))
    shares = np.zeros((sectors, rows))
    for sector in range(sectors):
        for sample in range(SAMPLES):
            direction = (sector + (sample + 0.5) / SAMPLES) * math.tau / sectors
            apart = np.abs(np.remainder(azimuths_rad - direction + math.pi, math.tau) - math.pi)
            if apart.min() <= 1.25 * typical:
                shares[sector, apart.argmin()] += 1 / SAMPLES
        seen = shares[sector].sum()
        shares[sector] = shares[sector] / seen if seen > 0.25 else 0.0
    return shares


def mean_power(scan: PolarScan, config: PolarGridConfig) -> np.ndarray:
    """(azimuths, range_bins) mean power of each cell, as the sum over the overlap of each bin of each row with it."""
    shares = rows_of_sectors(scan.azimuths_rad, config.azimuths)
    image = np.zeros((config.azimuths, config.range_bins))
    for column in range(config.range_bins):
        near_m, far_m = column * config.resolution_m, (column + 1) * config.resolution_m
        if (near_m + far_m) / 2 < config.min_range_m:
            continue
        for k in range(scan.power.shape[1]):
            start_m = scan.range_offset_m + k * scan.range_resolution_m
            common_m = min(far_m, start_m + scan.range_resolution_m) - max(near_m, start_m)
            if common_m > 0:
                image[:, column] += shares @ scan.power[:, k] * common_m / config.resolution_m
    return image


def smooth_scan(azimuths: np.ndarray, bins: int, resolution_m: float, range_offset_m: float = 0.0) -> PolarScan:
    """Power that varies over metres and degrees, so that rounding the range to whole bins changes little."""
    ranges = range_offset_m + (np.arange(bins) + 0.5) * resolution_m
    wave = 120 + 60 * np.sin(3 * azimuths)[:, np.newaxis] + 60 * np.cos(ranges / 9)[np.newaxis, :]
    return PolarScan(1, np.rint(wave).astype(np.uint8), azimuths, resolution_m, range_offset_m)


def even(rows: int = 60, first: float = 0.0) -> NDArray[np.float64]:
    return np.mod(np.linspace(0.0, math.tau, rows, endpoint=False) + first, math.tau)


AZIMUTHS = {
    'even': even(),
    'fewer than sectors': even(19),
    'not a multiple of the sectors': even(59),
    'another first azimuth': even(first=4.0),
    'first azimuth within a step': even(first=0.03),
    'counter-clockwise': even(first=1.0)[::-1],
    'jittered': np.mod(even() + np.random.default_rng(3).uniform(-0.04, 0.04, 60), math.tau),
    'one row lost': np.delete(even(), 17),
    'a third is missing': even()[20:],
    'the middle is missing': np.delete(even(), np.arange(11, 30)),
    'few': even(400)[:3],
    'two': even(400)[[0, 399]],
}


@pytest.mark.parametrize('name', AZIMUTHS)
def test_weights_of_rows_are_the_angles_that_they_cover(name: str) -> None:
    weights = sector_weights(AZIMUTHS[name], 24)
    assert weights.dtype == np.float32
    # A sample at the edge between two rows may count for either.
    np.testing.assert_allclose(weights, rows_of_sectors(AZIMUTHS[name], 24), atol=0.01)
    total = weights.sum(axis=1, dtype=np.float64)
    assert (np.isclose(total, 1.0) | (total == 0.0)).all()


@pytest.mark.parametrize('bins, resolution_m', SENSORS)
@pytest.mark.parametrize('range_offset_m', [0.0, 7.0, -3.3])
def test_smooth_scans_agree_cell_by_cell(bins: int, resolution_m: float, range_offset_m: float) -> None:
    scan = smooth_scan(even(), bins, resolution_m, range_offset_m)
    image, expected = PolarToGrid(SMALL)(scan), mean_power(scan, SMALL)
    # A column in which the scan begins or ends may change by half a bin.
    ends_m = np.array([range_offset_m, scan.max_range_m])
    inner = ~np.isin(np.arange(SMALL.range_bins), ends_m[ends_m % SMALL.resolution_m > 0] // SMALL.resolution_m)
    assert image.shape == (24, 16)
    assert image.dtype == np.uint8
    assert np.abs(image - expected)[:, inner].max() < 1.7
    assert np.abs(image - expected)[:, ~inner].max(initial=0.0) <= 200 * resolution_m / SMALL.resolution_m


@pytest.mark.parametrize('name', AZIMUTHS)
def test_noise_agrees_cell_by_cell_for_any_azimuths(name: str) -> None:
    power = np.random.default_rng(5).integers(0, 256, (len(AZIMUTHS[name]), 256)).astype(np.uint8)
    scan = PolarScan(1, power, AZIMUTHS[name], 0.25)
    assert np.abs(PolarToGrid(SMALL)(scan) - mean_power(scan, SMALL)).max() < 2.0


@pytest.mark.parametrize('bins, resolution_m', SENSORS)
def test_power_of_a_constant_scan_is_kept(bins: int, resolution_m: float) -> None:
    scan = PolarScan(1, np.full((400, bins), 93, np.uint8), even(400), resolution_m)
    image = PolarToGrid(CONFIG)(scan)
    assert image.shape == (200, 128)
    assert (image[:, :5] == 0).all()  # up to 2.5 m
    assert (image[:, 5:] == 93).all()


@pytest.mark.parametrize(('bins', 'resolution_m'), [*SENSORS, (12, 4.0)])
def test_columns_are_opencv_s_means_of_each_row(bins: int, resolution_m: float) -> None:
    """To the last bit: networks were trained with them."""
    power = np.random.default_rng(bins).integers(0, 256, (40, bins), dtype=np.uint8)
    azimuths_rad = np.linspace(0.0, math.tau, 40, endpoint=False) + math.pi / 40
    scan = PolarScan(0, power, azimuths_rad, resolution_m)
    grid = PolarGridConfig(azimuths=40, range_bins=16, resolution_m=bins * resolution_m / 16, min_range_m=0.0)
    np.testing.assert_array_equal(PolarToGrid(grid)(scan), cv2.resize(power, (16, 40), interpolation=cv2.INTER_AREA))


@pytest.mark.parametrize('bins, resolution_m', SENSORS)
@pytest.mark.parametrize('rows', [200, 400, 800])
def test_a_turn_by_whole_sectors_is_a_roll_of_the_rows(rows: int, bins: int, resolution_m: float) -> None:
    power = np.random.default_rng(1).integers(0, 256, (rows, bins)).astype(np.uint8)
    scan = PolarScan(1, power, even(rows), resolution_m)
    to_image = PolarToGrid(CONFIG)
    image = to_image(scan)
    for sectors in (1, 8, 57, 199):
        assert np.array_equal(to_image(spin(scan, sectors * rows // 200)), np.roll(image, sectors, axis=0))


@pytest.mark.parametrize('azimuth_deg, range_m', [(0.9, 30.2), (90.9, 30.3), (179.1, 3.2), (359.1, 63.8)])
def test_a_point_lands_in_its_cell(azimuth_deg: float, range_m: float) -> None:
    power = np.zeros((400, 3768), np.uint8)
    power[round(azimuth_deg / 0.9), int(range_m / 0.0432)] = 255
    image = PolarToGrid(CONFIG)(PolarScan(1, power, even(400), 0.0432))
    assert np.argwhere(image).tolist() == [[int(azimuth_deg / 1.8), int(range_m / 0.5)]]


def test_the_order_of_the_rows_does_not_change_the_image(make_scan: Callable[..., PolarScan]) -> None:
    scan = make_scan()
    to_image = PolarToGrid(CONFIG)
    for order in (np.roll(np.arange(400), 143), np.arange(400)[::-1], np.random.default_rng(2).permutation(400)):
        other = dataclasses.replace(scan, power=scan.power[order], azimuths_rad=scan.azimuths_rad[order])
        assert np.array_equal(to_image(other), to_image(scan))


def test_near_and_far_are_zero() -> None:
    scan = PolarScan(1, np.full((400, 800), 200, np.uint8), even(400), 0.05)
    image = PolarToGrid(dataclasses.replace(CONFIG, min_range_m=10.0))(scan)
    assert (image[:, :20] == 0).all()
    assert (image[:, 20:80] == 200).all()
    assert (image[:, 80:] == 0).all()  # beyond 40 m there is nothing


@pytest.mark.parametrize('range_offset_m', [-100.0, -70.0, 63.9, 64.1, 100.0])
def test_range_offsets_that_leave_few_or_no_columns(range_offset_m: float) -> None:
    scan = PolarScan(1, np.full((400, 1000), 200, np.uint8), even(400), 0.1, range_offset_m)
    image = PolarToGrid(CONFIG)(scan)
    near_m, far_m = range_offset_m, range_offset_m + 100.0
    for column in range(5, 128):
        inside = near_m <= column * 0.5 and (column + 1) * 0.5 <= far_m
        outside = (column + 1) * 0.5 <= near_m or column * 0.5 >= far_m
        assert not inside or (image[:, column] == 200).all()
        assert not outside or (image[:, column] == 0).all()


@pytest.mark.parametrize('bins, resolution_m', [(60, 1.3), (7, 10.0), (1, 10.0), (1, 0.1)])
def test_bins_longer_than_a_column_fill_all_columns_that_they_cover(bins: int, resolution_m: float) -> None:
    scan = PolarScan(1, np.full((400, bins), 50, np.uint8), even(400), resolution_m)
    for config in (CONFIG, PolarGridConfig(range_bins=8, resolution_m=0.01, min_range_m=0.0)):
        image = PolarToGrid(config)(scan)
        covered = np.arange(1, config.range_bins + 1) * config.resolution_m <= bins * resolution_m
        blanked = (np.arange(config.range_bins) + 0.5) * config.resolution_m < config.min_range_m
        assert (image[:, covered & ~blanked] == 50).all()


def test_a_missing_part_of_the_rotation_is_never_filled() -> None:
    azimuths = even(400)[100:320]
    image = PolarToGrid(CONFIG)(PolarScan(1, np.full((220, 3000), 200, np.uint8), azimuths, 0.05))
    # Rows 100 and 319 cover from 89.55° to 287.55°, and at such an end up to 1.25 steps: sectors of 1.8°.
    assert (image[:49] == 0).all()
    assert (image[50:160, 5:] == 200).all()
    assert (image[161:] == 0).all()


@pytest.mark.parametrize('rows', [2, 3, 5])
def test_the_first_rows_of_a_rotation_fill_only_their_sectors(rows: int) -> None:
    image = PolarToGrid(CONFIG)(PolarScan(1, np.full((rows, 3000), 200, np.uint8), even(400)[:rows], 0.05))
    filled = np.flatnonzero(image.any(axis=1))
    assert {0} <= set(filled.tolist()) <= {199, 0, 1, 2, 3}


def test_images_do_not_depend_on_the_scan_before(make_scan: Callable[..., PolarScan]) -> None:
    kept = PolarToGrid(CONFIG)
    for scan in (
        make_scan(),
        make_scan(bins=3000, resolution_m=0.04),
        make_scan(rows=399),
        make_scan(),
        make_scan(5, 9),
    ):
        assert np.array_equal(kept(scan), PolarToGrid(CONFIG)(scan))


@pytest.mark.parametrize(
    'file', ['oxford_tiny/radar/1547131046353776.png', 'mulran_kaist03/polar_oxford_form/000000.png']
)
def test_recorded_scans_keep_their_power(real_data: Path, file: str) -> None:
    scan = decode_png(real_data / file, 1, RadarConfig())
    image = PolarToGrid(CONFIG)(scan).astype(np.float64)
    first, last = (round(end_m / scan.range_resolution_m) for end_m in (2.5, 64.0))
    recorded = scan.power[:, first:last].astype(np.float64)
    assert image[:, 5:].mean() == pytest.approx(recorded.mean(), rel=0.01)
    # So does every direction, in tenths of a turn.
    around = image[:, 5:].reshape(10, 20, -1).mean(axis=(1, 2))
    np.testing.assert_allclose(around, rows_of_sectors(scan.azimuths_rad, 10) @ recorded.mean(axis=1), rtol=0.01)
