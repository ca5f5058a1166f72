"""PNG files that ask for more than an image: refused in one line, within little memory and time."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bounded_process import refusal

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.radar.png import SIGNATURE, check_png, decode_png

READ = 'from offradar_ros.config import RadarConfig\nfrom offradar_ros.radar.png import decode_png'
DECODE = 'decode_png(sys.argv[1], 1, RadarConfig(range_resolution_m=0.05))'
HEIGHT, WIDTH = 400, 60


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))


def png(pixels: bytes, *others: bytes, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    header = chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0))
    return SIGNATURE + header + b''.join(others) + chunk(b'IDAT', pixels) + chunk(b'IEND', b'')


ROWS = np.random.default_rng(0).integers(1, 256, (HEIGHT, WIDTH + 1)).astype(np.uint8)
ROWS[:, 0] = 0
PIXELS = zlib.compress(ROWS.tobytes())


def zeros(megabytes: int, before: bytes = b'') -> bytes:
    """Compressed zeros, `before` before them: after a full flush the same bytes stand for the same again."""
    compressor = zlib.compressobj(9)
    start = compressor.compress(before) + compressor.flush(zlib.Z_FULL_FLUSH)
    block = compressor.compress(bytes(2**20)) + compressor.flush(zlib.Z_FULL_FLUSH)
    return start + block * megabytes + compressor.flush()


BOMBS: dict[str, Callable[[], bytes]] = {
    'pixels that inflate to 1.5 GB': lambda: png(zeros(1500, ROWS.tobytes())),
    'pixels without end': lambda: png(PIXELS[:-9] + bytes(2 * 2**20)),
    'endless small chunks': lambda: png(PIXELS, chunk(b'tEXt', b'') * 140_000),
    'an image of 2 billion pixels': lambda: png(PIXELS, width=2**31 - 1),
    'rows that are missing': lambda: png(zlib.compress(ROWS[:200].tobytes())),
}


@pytest.mark.parametrize('case', BOMBS)
def test_a_bomb_is_refused(tmp_path: Path, case: str) -> None:
    path = tmp_path / 'bomb.png'
    path.write_bytes(BOMBS[case]())
    # libpng prints what it stumbles over.
    line = refusal(f'{READ}\nimport os\nos.close(2)', DECODE, path)
    assert line.startswith(f'{path}: ')


def test_texts_that_inflate_to_much_are_not_inflated(tmp_path: Path) -> None:
    data = png(PIXELS, chunk(b'zTXt', b'key\0\0' + zeros(500)), chunk(b'iCCP', b'key\0\0' + zeros(500)))
    assert np.array_equal(decode_png(data, 1, RadarConfig(range_resolution_m=0.05)).power, ROWS[:, 1:])


def test_large_pixel_data_of_an_image_is_read() -> None:
    rows = np.random.default_rng(1).integers(1, 256, (HEIGHT, 4001)).astype(np.uint8)
    rows[:, 0] = 0
    scan = decode_png(png(zlib.compress(rows.tobytes()), width=4000), 1, RadarConfig(range_resolution_m=0.05))
    assert np.array_equal(scan.power, rows[:, 1:])


def test_a_pipe_a_device_and_a_file_that_is_too_large_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe.png')
    with (tmp_path / 'large.png').open('wb') as file:
        file.truncate(2**33)
    for path in (tmp_path / 'pipe.png', Path('/dev/zero'), tmp_path / 'large.png'):
        with pytest.raises(DataError, match=rf'{path}: cannot be read'):
            decode_png(path, 1, RadarConfig())


def test_the_header_is_that_of_the_file() -> None:
    assert check_png(png(PIXELS), 'name') == (WIDTH, HEIGHT, 8, 0)
