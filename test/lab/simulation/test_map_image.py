"""Images of nav2 maps of every kind, and those that claim to be far larger than they are."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from bounded_process import refusal

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.map_image import read_map_image

PIXELS = np.array([[0, 255, 0], [255, 255, 0]], np.uint8)
READ = 'from offradar_ros.lab.simulation.map_image import read_map_image'


def map_of(folder: Path, image: bytes, name: str = 'map.img', more: str = '') -> Path:
    (folder / name).write_bytes(image)
    path = folder / 'map.yaml'
    path.write_text(f'image: {name}\nresolution: 0.5\norigin: [0, 0, 0]\n{more}')
    return path


def bmp_header(width: int, height: int, bits: int = 8, compression: int = 0) -> bytes:
    return b'BM' + struct.pack('<IIIIiiHHIIIIII', 54, 0, 54, 40, width, height, 1, bits, compression, 0, 0, 0, 0, 0)


READABLE = {
    'png': bytes(cv2.imencode('.png', PIXELS)[1]),
    'colour png': bytes(cv2.imencode('.png', np.dstack([PIXELS] * 3))[1]),
    'pgm': bytes(cv2.imencode('.pgm', PIXELS)[1]),
    'pgm with comments': b'P5\n# CREATOR: map_saver\n3 2\n# levels\n255\n' + PIXELS.tobytes(),
    'pgm as text': b'P2 3 2 255\n0 255 0\n255 255 0\n',
    'ppm': bytes(cv2.imencode('.ppm', np.dstack([PIXELS] * 3))[1]),
    'bmp': bytes(cv2.imencode('.bmp', PIXELS)[1]),
}


@pytest.mark.parametrize('kind', READABLE)
def test_images_of_every_kind_are_read(tmp_path: Path, kind: str) -> None:
    found = read_map_image(map_of(tmp_path, READABLE[kind]))
    assert found.occupied.tolist() == [[True, False, True], [False, False, True]]


REFUSED = {
    'pgm of 10^18 pixels': b'P5 999999999 999999999 255\n' + bytes(100),
    'pgm of 10^8 pixels without them': b'P5 10000 10000 255\n' + bytes(100),
    'pgm cut off': READABLE['pgm'][:-1],
    'bmp of 10^18 pixels': bmp_header(2**31 - 1, 2**31 - 1) + bytes(2000),
    'bmp of many pixels, run lengths': bmp_header(30_000, 30_000, compression=1) + bytes(2000),
    'bmp of many pixels without them': bmp_header(10_000, 10_000) + bytes(2000),
    'png of many pixels': READABLE['png'][:16] + struct.pack('>II', 60_000, 60_000) + READABLE['png'][24:],
    'png with a flipped bit': READABLE['png'][:-20] + b'\x01' + READABLE['png'][-19:],
    'jpeg': bytes(cv2.imencode('.jpg', PIXELS)[1]),
    'numbers without end': b'P5 ' + b'9' * 1000 + b' 1 255\n',
    'a comment without end': b'P5 #' + b'x' * 10**6,
    'nothing': b'',
}


@pytest.mark.parametrize('kind', REFUSED)
def test_what_claims_too_much_or_is_damaged_is_refused(tmp_path: Path, kind: str) -> None:
    path = map_of(tmp_path, REFUSED[kind])
    line = refusal(READ, 'read_map_image(sys.argv[1])', path)
    assert line.startswith(f'{tmp_path / "map.img"}: expected ')


def test_an_image_of_too_many_pixels_is_not_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('offradar_ros.lab.simulation.map_image._MAX_PIXELS', 5)
    monkeypatch.setattr(cv2, 'imdecode', lambda *_: pytest.fail('decoded'))
    for kind, image in READABLE.items():
        with pytest.raises(DataError, match='expected up to 5 pixels, got 3 × 2'):
            read_map_image(map_of(tmp_path, image, f'{kind}.img'))


def test_a_value_of_a_map_that_is_long_makes_a_short_line(tmp_path: Path) -> None:
    path = map_of(tmp_path, READABLE['png'])
    for name in ('origin', 'mode', 'negate', 'occupied_thresh', 'image'):
        lines = [line for line in path.read_text().splitlines() if not line.startswith(f'{name}:')]
        (tmp_path / 'long.yaml').write_text('\n'.join([*lines, f'{name}: [{"x, " * 2_000}x]']))
        with pytest.raises(DataError, match=f'{name}: expected') as refused:
            read_map_image(tmp_path / 'long.yaml')
        assert len(str(refused.value)) < 1000


@pytest.mark.parametrize('more', ['a: &a [x]\n' + ''.join(f'b{n}: &b [*a, *a]\n' for n in range(3)), 'x: ' + '[' * 99])
def test_a_map_file_that_is_no_map_is_refused(tmp_path: Path, more: str) -> None:
    path = map_of(tmp_path, READABLE['png'], more=more if '[' * 99 in more else f'{more}c: [*c]\n')
    with pytest.raises(DataError, match=r'map\.yaml: not a YAML file'):
        read_map_image(path)
