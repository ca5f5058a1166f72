"""A signature survives the way through bytes, and bytes that hold none are refused."""

from __future__ import annotations

import dataclasses
import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plane import make_plane

from offradar_ros.alignment.signature import BRIGHTEST, LONGEST_TURN_S, Signature, SignatureConfig, SignatureMaker
from offradar_ros.alignment.signature_code import MOST_BYTES, pack, unpack
from offradar_ros.alignment.twist import FASTEST, Twist
from offradar_ros.config import PolarGridConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.recordings.source import open_source

PACKED = pack(dataclasses.replace(SignatureMaker()(make_plane(3).scan()), twist=Twist(8.0, 0.1, 0.05)))
HEADER, CHECKSUM = 81, 4
SECONDS = st.floats(-LONGEST_TURN_S, LONGEST_TURN_S)


@st.composite
def configs(draw: st.DrawFn) -> SignatureConfig:
    range_bins = draw(st.integers(8, 160))
    resolution_m = draw(st.floats(0.1, 10.0))
    min_range_m = draw(st.floats(0.0, 0.4 * range_bins * resolution_m))
    grid = PolarGridConfig(draw(st.integers(8, min(720, 16_000 // range_bins))), range_bins, resolution_m, min_range_m)
    return SignatureConfig(grid, draw(st.floats(0.0, 255.0)), draw(st.floats(1.0, 255.0)))


@st.composite
def signatures(draw: st.DrawFn) -> Signature:
    config = draw(configs())
    shape = config.grid.azimuths, config.grid.range_bins
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    image = rng.integers(0, draw(st.integers(1, BRIGHTEST + 1)), shape, dtype=np.uint8)
    twist = draw(st.none() | st.builds(Twist, *[st.floats(-FASTEST, FASTEST)] * 3))
    seen = rng.random(shape[0]) < draw(st.floats(0.0, 1.0))
    return Signature(image, seen, draw(SECONDS), draw(SECONDS), twist, config)


def assert_same(found: Signature, expected: Signature) -> None:
    np.testing.assert_array_equal(found.image, expected.image)
    np.testing.assert_array_equal(found.seen, expected.seen)
    assert (found.image.dtype.name, found.seen.dtype.name) == ('uint8', 'bool')
    assert struct.pack('<2d', found.start_s, found.turn_s) == struct.pack('<2d', expected.start_s, expected.turn_s)
    assert found.config == expected.config
    assert repr(found.twist) == repr(expected.twist)


def refusal(content: bytes) -> str:
    with pytest.raises(RefusedInput) as refused:
        unpack(content)
    assert refused.value.cause == 'invalid_signature'
    assert '\n' not in str(refused.value)
    return str(refused.value)


def with_checksum(content: bytes) -> bytes:
    return content + struct.pack('<I', zlib.crc32(content))


@given(signatures())
def test_every_signature_comes_back_to_the_last_bit(signature: Signature) -> None:
    content = pack(signature)
    assert len(content) <= MOST_BYTES
    assert_same(unpack(content), signature)


def test_the_largest_signature_of_pure_noise_fits() -> None:
    rng = np.random.default_rng(0)
    for shape in ((200, 80), (100, 160), (720, 22)):
        config = SignatureConfig(PolarGridConfig(*shape, resolution_m=1.0, min_range_m=2.0))
        image = rng.integers(0, BRIGHTEST + 1, shape, dtype=np.uint8)
        noise = Signature(image, rng.random(shape[0]) < 0.5, 0.1, 0.25, config=config)
        assert_same(unpack(pack(noise)), noise)


@pytest.mark.parametrize('folder', ['oxford_tiny', 'mulran_kaist03', 'radiate_tiny_foggy'])
def test_recorded_scans_take_less_than_five_kilobytes(real_data: Path, folder: str) -> None:
    sequence = open_source(real_data / folder)
    make = SignatureMaker()
    for index in range(len(sequence)):
        signature = make(sequence.scan(index))
        content = pack(signature)
        assert len(content) < 5000
        assert_same(unpack(content), signature)


def test_levels_are_what_a_scan_shows_above_its_noise() -> None:
    scan = make_plane(3).scan()
    scan.power[10:12, 80:84] = 255
    signature = SignatureMaker()(scan)
    assert signature.image[5, 20] == signature.image.max() == BRIGHTEST
    assert (signature.image == 0).mean() > 0.5


@given(st.integers(0, len(PACKED) - 1), st.integers(1, 255))
def test_any_other_byte_is_noticed(at: int, flipped: int) -> None:
    refusal(PACKED[:at] + bytes([PACKED[at] ^ flipped]) + PACKED[at + 1 :])


@given(st.integers(0, len(PACKED) - 1))
def test_any_truncation_is_noticed(length: int) -> None:
    refusal(PACKED[:length])


@given(st.binary(max_size=300))
def test_any_other_bytes_are_refused(content: bytes) -> None:
    refusal(content)
    refusal(with_checksum(PACKED[:HEADER] + content))


@given(st.binary(min_size=1, max_size=2 * MOST_BYTES))
def test_nothing_may_follow(more: bytes) -> None:
    refusal(PACKED + more)
    refusal(with_checksum(PACKED[:-CHECKSUM] + more))


@pytest.mark.parametrize('size', [0, 1, 8024, 8026, 50_000_000])
def test_another_size_than_the_header_says_is_refused_without_inflating_it(size: int) -> None:
    bomb = zlib.compress(bytes(size), 9)[:8000]
    assert 'hold the 8025 bytes' in refusal(with_checksum(PACKED[:HEADER] + bomb))


# Offsets of the numbers in the header.
FIELDS = {'resolution_m': 9, 'min_range_m': 17, 'above_noise': 25, 'span': 33, 'start': 41, 'turn': 49, 'velocity': 57}


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 1e300, -1e300])
@pytest.mark.parametrize('field', FIELDS)
def test_numbers_that_make_no_signature_are_refused(field: str, value: float) -> None:
    content = bytearray(PACKED[:-CHECKSUM])
    struct.pack_into('<d', content, FIELDS[field], value)
    assert field in refusal(with_checksum(bytes(content)))


@pytest.mark.parametrize('shape', [(0, 0), (0, 80), (200, 0), (65535, 65535), (8, 161), (721, 8), (201, 80)])
def test_a_grid_of_a_wrong_size_is_refused(shape: tuple[int, int]) -> None:
    content = bytearray(PACKED[:-CHECKSUM])
    struct.pack_into('<HH', content, 5, *shape)
    assert 'cannot be made with' in refusal(with_checksum(bytes(content)))


def test_another_form_and_another_kind_of_file_are_named() -> None:
    later = bytearray(PACKED)
    later[4] = 2
    assert 'form 2, expected 1' in refusal(bytes(later))
    assert "starts with b'\\x89PNG'" in refusal(b'\x89PNG' + PACKED[4:])


@pytest.mark.parametrize('image', [np.full((200, 80), 16, np.uint8), np.zeros((200, 79), np.uint8)])
def test_what_is_no_signature_is_not_packed(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match='expected'):
        pack(Signature(image, np.ones(200, np.bool_)))
