from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.navtech_rows import join_rows
from offradar_ros.radar.png import decode_png
from offradar_ros.types import PolarScan

CONFIG = RadarConfig(range_resolution_m=0.05)


def png(image: np.ndarray) -> bytes:
    return bytes(cv2.imencode('.png', image)[1])


IMAGE = np.random.default_rng(0).integers(1, 256, (400, 60)).astype(np.uint8)
WHOLE = png(IMAGE)


def test_file_and_bytes_give_the_same_scan(tmp_path: Path, make_scan: Callable[..., PolarScan]) -> None:
    scan = make_scan(bins=100)
    path = tmp_path / 'scan.png'
    path.write_bytes(png(join_rows(scan, 5600)))
    for source in (path, str(path), path.read_bytes()):
        read = decode_png(source, 42, CONFIG)
        assert np.array_equal(read.power, scan.power)
        assert read.stamp_ns == 42
        assert read.azimuths_rad == pytest.approx(scan.azimuths_rad, abs=1e-9)


@given(cut=st.integers(0, len(WHOLE) - 1))
@settings(max_examples=60, deadline=None)
def test_a_truncated_file_is_an_error(cut: int) -> None:
    with pytest.raises(DataError, match=r'truncated PNG|empty file|not a PNG'):
        decode_png(WHOLE[:cut], 1, CONFIG)


@given(at=st.integers(8, len(WHOLE) - 1), bit=st.integers(0, 7))
@settings(max_examples=60, deadline=None)
def test_a_flipped_bit_is_an_error(at: int, bit: int) -> None:
    damaged = bytearray(WHOLE)
    damaged[at] ^= 1 << bit
    with pytest.raises(DataError):
        decode_png(bytes(damaged), 1, CONFIG)


@given(random_bytes=st.binary(max_size=200))
@settings(max_examples=60, deadline=None)
def test_random_bytes_are_an_error(random_bytes: bytes) -> None:
    for data in (random_bytes, WHOLE[:8] + random_bytes):
        with pytest.raises(DataError):
            decode_png(data, 1, CONFIG)


def test_bytes_after_the_end_are_ignored() -> None:
    assert np.array_equal(decode_png(WHOLE + b'more', 1, CONFIG).power, IMAGE)


@pytest.mark.parametrize(
    'image',
    [IMAGE.astype(np.uint16), np.dstack([IMAGE] * 3), np.dstack([IMAGE] * 4)],
    ids=['16 bit', 'colour', 'alpha'],
)
def test_only_8_bit_gray_is_read(image: np.ndarray) -> None:
    with pytest.raises(DataError, match='expected an 8-bit gray PNG'):
        decode_png(png(image), 1, CONFIG)


def test_a_huge_image_is_refused_before_it_is_decoded() -> None:
    header = struct.pack('>IIBBBBB', 2**30, 2**30, 8, 0, 0, 0, 0)
    chunks = [(b'IHDR', header), (b'IEND', b'')]
    data = WHOLE[:8] + b''.join(
        struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body)) for kind, body in chunks
    )
    with pytest.raises(RefusedInput) as refused:
        decode_png(data, 1, CONFIG)
    assert refused.value.cause == 'image_too_large'


def test_errors_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / '1547131046353776.png'
    with pytest.raises(DataError, match=path.name):
        decode_png(path, 1, CONFIG)
    path.write_bytes(WHOLE[:-20])
    with pytest.raises(DataError, match=path.name):
        decode_png(path, 1, CONFIG)
    path.write_bytes(png(np.zeros((400, 60), np.uint8)))
    with pytest.raises(RefusedInput, match=path.name) as refused:
        decode_png(path, 1, CONFIG)
    assert refused.value.cause == 'no_signal'


def test_both_layouts_of_a_mulran_scan_are_the_same_scan(real_data: Path) -> None:
    folder = real_data / 'mulran_kaist03'
    rows = decode_png(folder / 'polar_oxford_form' / '000000.png', 1, RadarConfig())
    columns = decode_png(folder / 'polar' / '000000.png', 1, RadarConfig())
    assert np.array_equal(rows.power, columns.power)
    assert rows.range_resolution_m == columns.range_resolution_m == 0.0595238
    # Bare polar does not know the encoder, which starts 7 of 5600 counts after zero.
    assert rows.azimuths_rad - columns.azimuths_rad == pytest.approx(np.full(400, 7 / 5600 * 2 * np.pi))
    aligned = decode_png(folder / 'polar' / '000000.png', 1, RadarConfig(azimuth_offset_rad=7 / 5600 * 2 * np.pi))
    assert aligned.azimuths_rad == pytest.approx(rows.azimuths_rad)
