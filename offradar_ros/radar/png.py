"""Polar scans stored as 8-bit gray PNG files.

libpng fills what it cannot read with zeros and only warns. So this file checks that a PNG is complete, chunk by chunk
(PNG specification, sections 5 and 11).
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.bounded_input import read_bounded
from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.image import decode_polar_image
from offradar_ros.types import PolarScan

SIGNATURE = b'\x89PNG\r\n\x1a\n'
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_COLOURS = {0: 'gray', 2: 'RGB', 3: 'palette', 4: 'gray with alpha', 6: 'RGBA'}
_OTHERS = {
    b'\xff\xd8\xff': 'JPEG, which changes the power',
    b'II*\0': 'TIFF',
    b'MM\0*': 'TIFF',
    b'BM': 'BMP',
    b'PK\x03\x04': 'a zip archive',
    b'\x1f\x8b': 'a gzip archive',
    b'version https://git-lfs': 'a pointer of Git LFS: git lfs pull fetches the file',
    b'<': 'a page of a web site, as for a download that failed',
}
_OTHER_CHUNKS = 1024**2
_MOST_CHUNKS = 2**17
_INFLATED_UNSEEN = 1024**2
_PIECE = 1024**2


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
        data = source if isinstance(source, bytes) else read_bounded(source, 2 * max_bytes + _OTHER_CHUNKS)
    except OSError as error:
        raise DataError(f'{name}: cannot be read ({error.strerror})') from None
    width, height, depth, colour = check_png(data, name)
    if (depth, colour) != (8, 0):
        raise DataError(f'{name}: expected an 8-bit gray PNG, got {depth}-bit {_COLOURS.get(colour, f"type {colour}")}')
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


class PngHeader(NamedTuple):
    """Of a PNG: pixels, bits of a channel, and colour type."""

    width: int
    height: int
    depth: int
    colour: int

    @property
    def most_pixel_bytes(self) -> int:
        """Bytes of all rows, each with the byte of its filter, at most: interlaced images have more rows."""
        row = self.width * _CHANNELS.get(self.colour, 4) * max(self.depth, 8) // 8 + 1
        return 2 * row * (self.height + 7)


def check_png(data: bytes, name: str) -> PngHeader:
    """The header of a complete PNG whose checksums are right; DataError, with `name`, for any other data."""
    if not data.startswith(SIGNATURE):
        kind = next((f', but {kind}' for start, kind in _OTHERS.items() if data.startswith(start)), '')
        raise DataError(f'{name}: not a PNG file{kind}' if data else f'{name}: empty file, expected a PNG')
    header: PngHeader | None = None
    pixels: list[memoryview] = []
    at = len(SIGNATURE)
    for _ in range(_MOST_CHUNKS):
        if at + 12 > len(data):
            break
        length, kind = struct.unpack_from('>I4s', data, at)
        end = at + 12 + length
        if end > len(data):
            break
        (checksum,) = struct.unpack_from('>I', data, end - 4)
        if zlib.crc32(memoryview(data)[at + 4 : end - 4]) != checksum:
            raise DataError(f'{name}: damaged PNG, the checksum of a {kind!r} chunk is wrong')
        if kind == b'IHDR' and length == 13:
            header = PngHeader(*struct.unpack_from('>IIBB', data, at + 8))
        if kind == b'IDAT':
            pixels.append(memoryview(data)[at + 8 : end - 4])
        if kind == b'IEND' and header is not None:
            _require_bounded(pixels, header, name)
            return header
        at = end
    raise DataError(f'{name}: truncated PNG, it ends after {len(data)} bytes')


def _require_bounded(pixels: list[memoryview], header: PngHeader, name: str) -> None:
    """DataError if the pixels inflate to more than the image: the decoder would inflate all, however much it is.

    Small data is not inflated first: a thousand times as much is a matter of seconds.
    """
    left = header.most_pixel_bytes
    if sum(map(len, pixels)) <= _INFLATED_UNSEEN:
        return
    decompressor = zlib.decompressobj()
    try:
        for part in pixels:
            unread: bytes | memoryview = part
            while unread and left >= 0 and not decompressor.eof:
                left -= len(decompressor.decompress(unread, min(left + 1, _PIECE)))
                unread = decompressor.unconsumed_tail
    except zlib.error as error:
        raise DataError(f'{name}: damaged PNG, its pixels cannot be decoded ({error})') from None
    if left < 0:
        raise DataError(f'{name}: damaged PNG, it holds more than its {header.height} rows of {header.width} pixels')
