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

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.radar import navtech_rows
from offradar_ros.radar.navtech_rows import Rows, has_metadata, join_rows
from offradar_ros.types import PolarScan

START_NS = 1_567_410_201_563_630_080


def split_rows(image: np.ndarray, encoder_size: int = 5600, **radar: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, stamps and power; for tests of images whose rows have stamps."""
    rows, power = navtech_rows.split_rows(image, RadarConfig(encoder_size=encoder_size, **radar))
    assert rows.stamps_ns is not None
    return rows.angles_rad, rows.stamps_ns, power


def rows_of(image: np.ndarray, stamp_ns: int | None = None, **radar: Any) -> Rows:
    return navtech_rows.split_rows(image, RadarConfig(**radar), stamp_ns)[0]


def packed_rows(stamps: list[int], encoders: list[int], valid: int, power: np.ndarray) -> np.ndarray:
    rows = [
        struct.pack('<qHB', stamp, encoder, valid) + bytes(values)
        for stamp, encoder, values in zip(stamps, encoders, power.tolist(), strict=True)
    ]
    return np.frombuffer(b''.join(rows), np.uint8).reshape(len(rows), -1)


@given(
    first=st.integers(0, 5599),
    rows=st.integers(5, 60),
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


@given(
    rows=st.integers(16, 400),
    bins=st.integers(1, 16),
    size=st.sampled_from([5600, 16000]),
    first=st.integers(0, 15999),
    seed=st.integers(0, 999),
)
@settings(max_examples=40, deadline=None)
def test_joined_rows_are_split_again(rows: int, bins: int, size: int, first: int, seed: int) -> None:
    """A turn of rows that are not quite evenly spaced, as far as counts can say it."""
    random = np.random.default_rng(seed)
    step = size / rows
    jitter = random.integers(-int(step / 10), int(step / 10) + 1, rows)
    counts = np.mod(first + np.rint(step * np.arange(rows)).astype(int) + jitter, size)
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


def sound_image(counts: np.ndarray | None = None, stamps: np.ndarray | None = None, bins: int = 3768) -> np.ndarray:
    """A writable image of 400 rows, as Oxford has them."""
    counts = 7 + 14 * np.arange(400) if counts is None else counts
    stamps = START_NS // 1000 + 625 * np.arange(400) if stamps is None else stamps
    power = np.random.default_rng(3).integers(1, 200, (len(counts), bins)).astype(np.uint8)
    image: np.ndarray = packed_rows(stamps.tolist(), counts.tolist(), 255, power).copy()
    return image


@pytest.mark.parametrize(
    'stamps',
    [
        np.zeros(400, int),
        900_000_000 + 625 * np.arange(400),
        np.full(400, -5),
        np.random.default_rng(0).integers(-(2**62), 2**62, 400),
        START_NS + 625_000 * np.arange(400) + np.where(np.arange(400) < 200, 0, 3600 * 10**9),
        START_NS // 10**6 + np.arange(400) * 625 // 1000,
    ],
    ids=['zero', 'from 1970', 'negative', 'random', 'set during the scan', 'milliseconds'],
)
def test_metadata_of_a_clock_that_nobody_set_is_recognised_and_its_stamps_are_not_used(stamps: np.ndarray) -> None:
    image = sound_image(stamps=stamps)
    assert has_metadata(image)
    rows = rows_of(image, START_NS)
    assert rows.angles_rad == pytest.approx((7 + 14 * np.arange(400)) * 2 * np.pi / 5600)
    assert rows.stamps_ns is None
    assert rows.faults == {'stamp_unusable': 400}


@pytest.mark.parametrize('first_ns', [12 * 10**9, 5_000_000_000_000_000_000])
def test_stamps_of_any_clock_are_used_if_it_is_that_of_the_scan(first_ns: int) -> None:
    """As of a simulation, whose time starts at zero."""
    stamps_ns = first_ns + 625_000 * np.arange(400)
    for unit in (1, 1000):
        image = sound_image(stamps=stamps_ns // unit)
        assert has_metadata(image)
        assert rows_of(image, first_ns).stamps_ns == pytest.approx(stamps_ns)


def without_counts(kind: str) -> np.ndarray:
    counts = np.zeros(400, int)
    if kind == 'zero but for the last rows':
        counts[-9:] = 7 + 14 * np.arange(391, 400)
    if kind == 'all the same':
        counts[:] = 7
    if kind == 'decreasing':
        counts = (7 + 14 * np.arange(400))[::-1]
    return sound_image(counts)


@pytest.mark.parametrize('kind', ['all zero', 'zero but for the last rows', 'all the same', 'decreasing'])
def test_rows_without_counts_are_refused_with_the_way_out(kind: str) -> None:
    image = without_counts(kind)
    assert has_metadata(image)
    with pytest.raises(RefusedInput) as refused:
        rows_of(image)
    assert refused.value.cause == 'no_row_angles'
    assert 'polar or ray' in str(refused.value)
    assert 'metadata_columns' not in str(refused.value)
    rows = rows_of(image, row_angles='equal')
    assert rows.angles_rad == pytest.approx(np.radians(0.9 * np.arange(400)))
    assert rows.stamps_ns is not None


@pytest.mark.parametrize('turns', [1, 2, 3])
@pytest.mark.parametrize('mirrored', [False, True])
def test_a_turned_or_mirrored_image_is_refused_as_such(turns: int, mirrored: bool) -> None:
    image = np.rot90(sound_image(), turns)
    image = np.ascontiguousarray(np.fliplr(image) if mirrored else image)
    if mirrored and turns == 2:
        # Rows in reverse order still start with their metadata.
        assert has_metadata(image)
        return
    assert not has_metadata(image)
    with pytest.raises(RefusedInput, match='turned or mirrored') as refused:
        rows_of(image)
    assert refused.value.cause == 'turned_image'


def test_rows_of_power_alone_are_refused_where_metadata_is_required() -> None:
    image = np.random.default_rng(0).integers(0, 256, (400, 3360)).astype(np.uint8)
    with pytest.raises(RefusedInput, match=r'set radar\.metadata_columns to 0 if all 3360 bytes are power') as refused:
        rows_of(image)
    assert refused.value.cause == 'no_metadata'


def test_a_row_that_lost_its_metadata_keeps_its_power_at_the_right_angle() -> None:
    image = sound_image()
    image[[0, 100, 101, 399], :11] = 0
    rows = rows_of(image)
    assert rows.angles_rad == pytest.approx((7 + 14 * np.arange(400)) * 2 * np.pi / 5600)
    assert rows.faults == {'angle_interpolated': 4, 'stamp_interpolated': 4}


@given(
    wrong=st.integers(1, 190),
    seed=st.integers(0, 2**32 - 1),
    columns=st.sampled_from(['stamp', 'count', 'low byte', 'all']),
)
@settings(max_examples=100, deadline=None)
def test_rows_of_damaged_metadata_are_mended_or_refused_and_never_power(wrong: int, seed: int, columns: str) -> None:
    """Any bytes in the first columns of some rows."""
    random = np.random.default_rng(seed)
    image = sound_image(bins=30)
    at = random.permutation(400)[:wrong]
    first, end = {'stamp': (0, 8), 'count': (8, 10), 'low byte': (8, 9), 'all': (0, 11)}[columns]
    image[at, first:end] = random.integers(0, 256, (wrong, end - first))
    assert has_metadata(image)
    try:
        rows = rows_of(image, START_NS)
    except RefusedInput as refusal:
        assert wrong > 30
        assert refusal.cause in ('unsound_rows', 'no_row_angles', 'unknown_turn', 'uneven_rows')
    else:
        apart = np.mod(rows.angles_rad - (7 + 14 * np.arange(400)) * 2 * np.pi / 5600 + np.pi, 2 * np.pi) - np.pi
        assert np.abs(apart).max() <= 1.5 * 14 * 2 * np.pi / 5600


@given(data=st.binary(min_size=12 * 16, max_size=12 * 40))
@settings(max_examples=200, deadline=None)
def test_any_bytes_give_rows_or_a_refusal(data: bytes) -> None:
    image = np.frombuffer(data[: len(data) // 12 * 12], np.uint8).reshape(-1, 12)
    try:
        rows = rows_of(image, START_NS)
    except RefusedInput as refusal:
        assert '\n' not in str(refusal)
    else:
        assert np.all((rows.angles_rad >= 0) & (rows.angles_rad < 2 * np.pi))


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
    azimuths, stamps, power = split_rows(image)
    assert rows_of(image).faults == {}
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
