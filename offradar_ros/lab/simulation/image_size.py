"""Width and height that an image claims, before anything of that size is made: PNG, PGM, PPM or BMP."""

from __future__ import annotations

import re
import struct

from offradar_ros.errors import DataError
from offradar_ros.radar.png import SIGNATURE, check_png

_BLANK = rb'(?:[ \t\r\n]|#[^\n]*\n)+'
_PNM = re.compile(rb'P([2356])' + _BLANK + rb'(\d{1,9})' + _BLANK + rb'(\d{1,9})' + _BLANK + rb'(\d{1,5})[ \t\r\n]')
_MAX_COMMENTS = 64 * 1024


def image_size(data: bytes) -> tuple[int, int]:
    """Width and height in pixels; ValueError if the data is none of these, damaged, or too short for its size."""
    if data.startswith(SIGNATURE):
        try:
            header = check_png(data, 'PNG')
        except DataError as error:
            raise ValueError(str(error)) from None
        return header.width, header.height
    found = _PNM.match(data, 0, _MAX_COMMENTS)
    if found:
        kind, width, height, _ = (int(number) for number in found.groups())
        values = width * height * (3 if kind in (3, 6) else 1)
        # A value in text takes a digit and a blank, the last one only a digit.
        least = values if kind in (5, 6) else 2 * values - 1
    elif data.startswith(b'BM') and len(data) >= 54:
        width, height, _, bits, compression = struct.unpack_from('<iiHHI', data, 18)
        width, height = abs(width), abs(height)
        least = 0 if compression else width * height * bits // 8
    else:
        raise ValueError('got another file')
    if len(data) - (found.end() if found else 54) < least:
        raise ValueError(f'{width} × {height} pixels do not fit into its {len(data)} bytes')
    return width, height
