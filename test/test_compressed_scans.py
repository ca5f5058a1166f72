"""Polar scans in CompressedImage: a PNG is read as the Image of the same pixels, anything else is refused by cause."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from recorded_topics import compressed_message, jpeg, png

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.messages import scan_from_compressed, scan_from_image
from offradar_ros.radar.navtech_rows import join_rows
from offradar_ros.recordings.bags.writer import image_message

STAMP_NS = 1_600_000_000_250_000_000
FORMATS = ('png', 'mono8; png compressed ', '8UC1; png compressed', 'PNG', '', 'jpeg')


@pytest.fixture
def scan(street: Callable[..., Any]) -> Any:
    return street(count=2).scan(1)


@pytest.mark.parametrize('form', FORMATS)
def test_a_png_is_the_same_scan_as_the_image(scan: Any, form: str) -> None:
    raw = scan_from_image(image_message(scan, plain=True), RadarConfig())
    found = scan_from_compressed(compressed_message(scan.stamp_ns, png(scan.power), form), RadarConfig())
    np.testing.assert_array_equal(found.power, raw.power)
    np.testing.assert_array_equal(found.azimuths_rad, raw.azimuths_rad)
    assert (found.stamp_ns, found.range_resolution_m) == (raw.stamp_ns, raw.range_resolution_m)


def test_metadata_columns_and_azimuths_as_columns_are_read_as_in_an_image(scan: Any) -> None:
    rows = join_rows(scan, 5600)
    with_columns = scan_from_compressed(compressed_message(STAMP_NS, png(rows)), RadarConfig())
    np.testing.assert_array_equal(with_columns.power, scan.power)
    assert with_columns.azimuth_stamps_ns is not None
    turned = scan_from_compressed(compressed_message(STAMP_NS, png(scan.power.T)), RadarConfig())
    np.testing.assert_array_equal(turned.power, scan.power)


def damaged(data: bytes) -> bytes:
    return data[:500] + bytes(20) + data[520:]


@pytest.mark.parametrize(
    ('make', 'cause', 'expected'),
    [
        (jpeg, 'lossy_image', "image_transport's parameter format: png"),
        (lambda power: png(cv2.merge([power] * 3)), 'wrong_encoding', '8-bit gray'),
        (lambda power: png(power.astype(np.uint16)), 'wrong_encoding', 'got 16-bit gray'),
        (lambda power: png(power)[:5000], 'wrong_encoding', 'truncated PNG'),
        (lambda power: damaged(png(power)), 'wrong_encoding', 'damaged PNG'),
        (lambda power: bytes(12) + png(power), 'wrong_encoding', 'not a PNG'),
        (lambda power: b'', 'wrong_encoding', 'empty file'),
        (lambda power: png(np.zeros_like(power)), 'no_signal', 'zero'),
    ],
)
def test_anything_else_is_refused_with_its_cause(scan: Any, make: Any, cause: str, expected: str) -> None:
    with pytest.raises(RefusedInput, match=expected) as refused:
        scan_from_compressed(compressed_message(STAMP_NS, make(scan.power)), RadarConfig())
    assert refused.value.cause == cause


def test_a_size_is_refused_before_anything_is_decoded() -> None:
    """A picture of 10^12 pixels in a hundred bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))

    header = struct.pack('>IIBBBBB', 10**6, 10**6, 8, 0, 0, 0, 0)
    bomb = b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + chunk(b'IDAT', zlib.compress(b'')) + chunk(b'IEND', b'')
    with pytest.raises(RefusedInput) as refused:
        scan_from_compressed(compressed_message(STAMP_NS, bomb), RadarConfig())
    assert refused.value.cause == 'image_too_large'
