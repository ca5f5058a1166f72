"""Polar scans stored as 8-bit gray PNG files.

libpng fills what it cannot read with zeros and only warns. So this file checks that a PNG is complete, chunk by chunk
(PNG specification, sections 5 and 11).
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.image import decode_polar_image
from offradar_ros.types import PolarScan

_SIGNATURE = b'\x89PNG\r\n\x1a\n'


def decode_png(source: str | Path | bytes, stamp_ns: int, config: RadarConfig) -> PolarScan:
    """One scan from a PNG file or its bytes; `config` says how rows, columns and ranges are read.

    DataError for a file that is missing, truncated, damaged or not 8-bit gray; RefusedInput as `decode_polar_image`.
    """
    name = 'PNG data' if isinstance(source, bytes) else str(source)
    image = read_gray_png(source, config.max_image_bytes)
    height, width = image.shape
    try:
        return decode_polar_image(
            image, height=height, width=width, step=width, encoding='mono8', stamp_ns=stamp_ns, config=config
        )
    except RefusedInput as refusal:
        raise RefusedInput(refusal.cause, f'{name}: {refusal}') from None


def read_gray_png(source: str | Path | bytes, max_bytes: int) -> NDArray[np.uint8]:
    """(height, width) uint8, contiguous. DataError as `decode_png`; RefusedInput('image_too_large')."""
    name = 'PNG data' if isinstance(source, bytes) else str(source)
    try:
        data = source if isinstance(source, bytes) else Path(source).read_bytes()
    except OSError as error:
        raise DataError(f'{name}: cannot be read ({error.strerror})') from None
    width, height = _checked_size(data, name)
    if width * height > max_bytes:
        raise RefusedInput(
            'image_too_large', f'{name}: {height} rows of {width} bytes is over radar.max_image_bytes = {max_bytes}'
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None or image.dtype != np.uint8 or image.shape != (height, width):
        raise DataError(f'{name}: damaged PNG, its pixels cannot be decoded')
    return np.asarray(image, np.uint8)


def _checked_size(data: bytes, name: str) -> tuple[int, int]:
    """Width and height of a complete 8-bit gray PNG."""
    if not data.startswith(_SIGNATURE):
        raise DataError(f'{name}: not a PNG file' if data else f'{name}: empty file, expected a PNG')
    size: tuple[int, int] | None = None
    at = len(_SIGNATURE)
    while at + 12 <= len(data):
        length, kind = struct.unpack_from('>I4s', data, at)
        end = at + 12 + length
        if end > len(data):
            break
        (checksum,) = struct.unpack_from('>I', data, end - 4)
        if zlib.crc32(memoryview(data)[at + 4 : end - 4]) != checksum:
            raise DataError(f'{name}: damaged PNG, the checksum of a {kind!r} chunk is wrong')
        if kind == b'IHDR' and length == 13:
            width, height, depth, colour = struct.unpack_from('>IIBB', data, at + 8)
            if (depth, colour) != (8, 0):
                raise DataError(f'{name}: expected an 8-bit gray PNG, got bit depth {depth} and colour type {colour}')
            size = (width, height)
        if kind == b'IEND' and size is not None:
            return size
        at = end
    raise DataError(f'{name}: truncated PNG, it ends after {len(data)} bytes')
