from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from radar_images import read_image

from offradar_ros.errors import RefusedInput
from offradar_ros.radar.navtech_rows import full_turn_counts, has_metadata, join_rows, split_rows
from offradar_ros.types import PolarScan

START_NS = 1_567_410_201_563_630_080


def packed_rows(stamps: list[int], encoders: list[int], valid: int, power: np.ndarray) -> np.ndarray:
    rows = [
        struct.pack('<qHB', stamp, encoder, valid) + bytes(values)
        for stamp, encoder, values in zip(stamps, encoders, power.tolist(), strict=True)
    ]
    return np.frombuffer(b''.join(rows), np.uint8).reshape(len(rows), -1)


@given(
    first=st.integers(0, 5599),
    rows=st.integers(4, 60),
    bins=st.integers(1, 20),
    scale=st.sampled_from([1, 1000]),
    valid=st.sampled_from([0, 1, 255]),
    seed=st.integers(0, 2**32 - 1),
)
@example(first=5348, rows=19, bins=1, scale=1, valid=0, seed=0)
@settings(max_examples=60, deadline=None)
def test_packed_rows_are_read_back(first: int, rows: int, bins: int, scale: int, valid: int, seed: int) -> None:
    power = np.random.default_rng(seed).integers(0, 256, (rows, bins)).astype(np.uint8)
    stamps_ns = [START_NS // 1000 * 1000 + 620_000 * k for k in range(rows)]
    encoders = [(first + 14 * k) % 5600 for k in range(rows)]
    image = packed_rows([s // scale for s in stamps_ns], encoders, valid, power)
    assert has_metadata(image)
    azimuths, stamps, read = split_rows(image, 5600)
    assert stamps.tolist() == stamps_ns
    assert azimuths == pytest.approx([e / 5600 * 2 * np.pi for e in encoders], abs=1e-9)
    assert np.array_equal(read, power)
    assert read.base is not None


@given(rows=st.integers(4, 400), bins=st.integers(1, 16), size=st.sampled_from([5600, 16000]), seed=st.integers(0, 999))
@settings(max_examples=40, deadline=None)
def test_joined_rows_are_split_again(rows: int, bins: int, size: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    counts = np.sort(random.choice(size, rows, replace=False))
    scan = PolarScan(
        START_NS,
        random.integers(0, 256, (rows, bins)).astype(np.uint8),
        np.asarray(counts * (2 * np.pi / size), np.float64),
        0.05,
        azimuth_stamps_ns=START_NS + np.arange(rows, dtype=np.int64) * 625_001,
    )
    image = join_rows(scan, size)
    assert has_metadata(image)
    azimuths, stamps, power = split_rows(image, size)
    assert np.array_equal(power, scan.power)
    assert scan.azimuth_stamps_ns is not None
    assert np.array_equal(stamps, scan.azimuth_stamps_ns)
    assert azimuths == pytest.approx(scan.azimuths_rad, abs=1e-9)


def test_rows_of_a_scan_without_row_stamps_get_its_stamp(make_scan: Callable[..., PolarScan]) -> None:
    scan = make_scan()
    image = join_rows(scan, 5600)
    assert has_metadata(image)
    _, stamps, _ = split_rows(image, 5600)
    assert set(stamps.tolist()) == {scan.stamp_ns}


@given(seed=st.integers(0, 2**32 - 1), top=st.integers(1, 256))
@settings(max_examples=60, deadline=None)
def test_power_alone_is_not_recognised_as_metadata(seed: int, top: int) -> None:
    assert not has_metadata(np.random.default_rng(seed).integers(0, top, (40, 64)).astype(np.uint8))


@pytest.mark.parametrize('value', [0, 5, 255])
def test_constant_images_are_not_recognised_as_metadata(value: int) -> None:
    assert not has_metadata(np.full((400, 3779), value, np.uint8))


def test_azimuths_and_stamps_of_rows_that_were_not_measured_are_interpolated() -> None:
    power = np.ones((40, 8), np.uint8)
    stamps = [START_NS + 625_000 * k for k in range(40)]
    image = packed_rows(stamps, [7 + 140 * k for k in range(40)], 255, power).copy()
    whole = split_rows(image, 5600)
    image[:15] = 0
    image[30:] = 0
    assert has_metadata(image)
    azimuths, row_stamps, read = split_rows(image, 5600)
    assert azimuths == pytest.approx(whole[0], abs=1e-9)
    assert row_stamps.tolist() == stamps
    assert read[:15].max() == 0
    assert read[20].min() == 1


def test_a_larger_encoder_is_recognised_by_its_counts() -> None:
    assert full_turn_counts(np.array([0, 5599]), 5600) == 5600
    assert full_turn_counts(np.array([0, 5600]), 5600) == 16000
    assert full_turn_counts(np.array([0, 15990]), 5600) == 16000
    assert full_turn_counts(np.array([0, 65535]), 16000) == 65536


def test_constant_encoder_counts_are_refused() -> None:
    image = packed_rows([START_NS + k for k in range(10)], [7] * 10, 255, np.ones((10, 4), np.uint8))
    assert not has_metadata(image)
    with pytest.raises(RefusedInput, match=r'radar\.metadata_columns') as refused:
        split_rows(image, 5600)
    assert refused.value.cause == 'wrong_size'


@pytest.mark.parametrize(
    ('file', 'first_encoder', 'first_stamp_ns'),
    [
        ('oxford_tiny/radar/1547131046353776.png', 13, 1_547_131_046_353_776_000),
        ('mulran_kaist03/polar_oxford_form/000000.png', 7, 1_567_410_201_563_630_080),
        ('utias_frame/test_frame.png', 7, 1_733_239_501_859_565_000),
    ],
)
def test_recorded_rows(real_data: Path, file: str, first_encoder: int, first_stamp_ns: int) -> None:
    image = read_image(real_data / file)
    assert has_metadata(image)
    assert not has_metadata(image[:, 11:])
    azimuths, stamps, power = split_rows(image, 5600)
    assert power.shape == (400, image.shape[1] - 11)
    assert azimuths[0] == pytest.approx(first_encoder / 5600 * 2 * np.pi)
    assert np.allclose(np.diff(azimuths), 14 / 5600 * 2 * np.pi)
    assert stamps[0] == first_stamp_ns
    assert 0.24e9 < stamps[-1] - stamps[0] < 0.26e9


def test_the_valid_column_of_utias_is_ignored(real_data: Path) -> None:
    image = read_image(real_data / 'utias_frame' / 'test_frame.png')
    assert set(np.unique(image[:, 10])) == {0, 255}
    assert len(split_rows(image, 5600)[0]) == 400


@pytest.mark.parametrize('file', ['mulran_kaist03/polar/000000.png', 'radiate_tiny_foggy/Navtech_Polar/000001.png'])
def test_recorded_images_without_metadata(real_data: Path, file: str) -> None:
    image = read_image(real_data / file)
    assert not has_metadata(image)
    assert not has_metadata(image.T)


def test_the_live_message_has_no_metadata(live_image: dict[str, Any]) -> None:
    assert not has_metadata(np.frombuffer(live_image['data'], np.uint8).reshape(400, 6848))
