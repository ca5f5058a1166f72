from __future__ import annotations

import array
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.image import decode_polar_image
from offradar_ros.radar.navtech_rows import join_rows
from offradar_ros.types import PolarScan

STAMP_NS = 1_700_000_000_123_456_789
CONFIG = RadarConfig(range_resolution_m=0.05)


def fields(image: np.ndarray, **changes: Any) -> dict[str, Any]:
    height, width = image.shape
    given = {
        'data': image.tobytes(),
        'height': height,
        'width': width,
        'step': width,
        'encoding': '8UC1',
        'stamp_ns': STAMP_NS,
        'config': CONFIG,
    }
    return {**given, **changes}


def powers(rows: int = 400, bins: int = 50) -> np.ndarray:
    return np.random.default_rng(1).integers(1, 256, (rows, bins)).astype(np.uint8)


def test_an_image_of_a_driver_is_decoded_unchanged() -> None:
    image = powers()
    scan = decode_polar_image(**fields(image))
    assert np.array_equal(scan.power, image)
    assert scan.azimuths_rad == pytest.approx([math.radians(0.9 * k) for k in range(400)])
    assert (scan.stamp_ns, scan.range_resolution_m, scan.range_offset_m) == (STAMP_NS, 0.05, 0.0)
    assert scan.azimuth_stamps_ns is None


@pytest.mark.parametrize('kind', [bytes, bytearray, memoryview, lambda b: array.array('B', b), np.frombuffer])
def test_any_buffer_gives_the_same_scan(kind: Callable[..., Any]) -> None:
    image = powers()
    data = np.frombuffer(image.tobytes(), np.uint8) if kind is np.frombuffer else kind(image.tobytes())
    assert np.array_equal(decode_polar_image(**fields(image, data=data)).power, image)


def test_power_is_a_view_of_the_message() -> None:
    image = powers()
    assert np.shares_memory(decode_polar_image(**fields(image, data=image)).power, image)


@given(
    rows=st.integers(2, 30), bins=st.integers(2, 40), padding=st.integers(0, 9), cut=st.booleans(), mono=st.booleans()
)
@settings(max_examples=60, deadline=None)
def test_padding_between_rows_is_ignored(rows: int, bins: int, padding: int, cut: bool, mono: bool) -> None:
    image = powers(rows, bins)
    image[:, :2] = 0, 1
    padded = np.full((rows, bins + padding), 77, np.uint8)
    padded[:, :bins] = image
    data = padded.tobytes()
    if cut:
        data = data[: len(data) - padding]
    scan = decode_polar_image(
        **fields(
            image,
            data=data,
            step=bins + padding,
            encoding='mono8' if mono else '8UC1',
            config=RadarConfig(range_resolution_m=0.05, azimuth_axis='rows', metadata_columns='0', azimuth_samples=8),
        )
    )
    assert np.array_equal(scan.power, image)


@pytest.mark.parametrize(('shape', 'turned'), [((3360, 400), True), ((576, 400), True), ((400, 3360), False)])
def test_the_azimuth_axis_is_the_one_with_400(shape: tuple[int, int], turned: bool) -> None:
    image = powers(*shape)
    scan = decode_polar_image(**fields(image))
    assert np.array_equal(scan.power, image.T if turned else image)
    assert scan.power.shape[0] == 400
    assert scan.power.flags.c_contiguous


@pytest.mark.parametrize(
    ('shape', 'rows'),
    [((399, 3360), 399), ((3360, 399), 399), ((120, 2856), 120), ((100, 650), 100), ((650, 100), 100)],
)
def test_without_400_the_azimuth_axis_is_the_shorter_one(shape: tuple[int, int], rows: int) -> None:
    assert decode_polar_image(**fields(powers(*shape))).power.shape[0] == rows


@pytest.mark.parametrize(('axis', 'rows'), [('rows', 60), ('columns', 400)])
def test_the_azimuth_axis_can_be_configured(axis: str, rows: int) -> None:
    config = RadarConfig(range_resolution_m=0.05, azimuth_axis=axis, azimuth_samples=rows)
    assert decode_polar_image(**fields(powers(60, 400), config=config)).power.shape[0] == rows


def test_a_partial_image_holds_the_first_rows_of_a_rotation() -> None:
    scan = decode_polar_image(**fields(powers(399, 3360)))
    assert scan.azimuths_rad[-1] == pytest.approx(math.radians(0.9 * 398))
    partial = decode_polar_image(**fields(powers(100, 3360)))
    assert partial.azimuths_rad[-1] == pytest.approx(math.radians(0.9 * 99))
    assert (scan.row_faults, partial.row_faults) == ({}, {'missing': 300})


def blind(*seeing: int, value: int = 255) -> np.ndarray:
    """A scan in which all rows but the first, of `seeing` rows, hold one value only."""
    image = np.full((400, 50), value, np.uint8)
    image[: sum(seeing)] = powers()[: sum(seeing)]
    return image


@pytest.mark.parametrize(
    'image',
    [
        *(blind(99, value=value) for value in (255, 17, 0)),
        *(powers(rows, 3360) for rows in (99, 1)),
        np.repeat(powers(400, 1), 50, axis=1),
    ],
    ids=['saturated', 'constant', 'dark', 'part of a rotation', 'one row', 'rows of one value each'],
)
def test_a_scan_that_shows_too_little_is_refused(image: np.ndarray) -> None:
    with pytest.raises(RefusedInput, match='of the 400 rows of a rotation power changes with range: expected') as told:
        decode_polar_image(**fields(image))
    assert told.value.cause == 'too_few_rows'


def test_a_sector_without_power_is_no_reason_to_refuse_a_scan() -> None:
    assert decode_polar_image(**fields(blind(100, value=0))).row_faults == {'no_power': 300}


def test_more_rows_than_azimuth_samples_are_one_rotation() -> None:
    assert decode_polar_image(**fields(powers(800, 3360))).azimuths_rad[1] == pytest.approx(math.radians(0.45))


def test_rows_never_measured_stay_zero() -> None:
    image = powers()
    image[:130] = 0
    scan = decode_polar_image(**fields(image))
    assert scan.power[:130].max() == 0
    assert scan.power.shape[0] == 400


def test_offset_and_sense_turn_the_azimuths() -> None:
    image = powers(8, 200)
    config = RadarConfig(range_resolution_m=0.05, azimuth_samples=8, azimuth_offset_rad=0.25)
    scan = decode_polar_image(**fields(image, config=config))
    assert scan.azimuths_rad == pytest.approx([0.25 + k * math.tau / 8 for k in range(8)])
    other = RadarConfig(range_resolution_m=0.05, azimuth_samples=8, azimuth_direction='counterclockwise')
    scan = decode_polar_image(**fields(image, config=other))
    assert scan.azimuths_rad == pytest.approx([0.0] + [math.tau - k * math.tau / 8 for k in range(1, 8)])
    assert np.array_equal(scan.power, image)


@given(offset=st.floats(-math.tau, math.tau), sense=st.sampled_from(['clockwise', 'counterclockwise']))
@settings(max_examples=60, deadline=None)
def test_azimuths_are_always_within_one_turn(offset: float, sense: str) -> None:
    config = RadarConfig(range_resolution_m=0.05, azimuth_samples=8, azimuth_offset_rad=offset, azimuth_direction=sense)
    azimuths = decode_polar_image(**fields(powers(8, 200), config=config)).azimuths_rad
    assert np.all((azimuths >= 0) & (azimuths < math.tau))


def test_metadata_columns_are_recognised_or_configured(make_scan: Callable[..., PolarScan]) -> None:
    image = join_rows(make_scan(bins=3768), 5600)
    auto = RadarConfig()
    assert decode_polar_image(**fields(image, config=auto)).power.shape == (400, 3768)
    plain = RadarConfig(range_resolution_m=0.05, metadata_columns='0')
    assert decode_polar_image(**fields(image, config=plain)).power.shape == (400, 3779)
    required = RadarConfig(metadata_columns='11')
    scan = decode_polar_image(**fields(image, config=required))
    assert scan.azimuth_stamps_ns is not None


def test_the_range_offset_is_passed_on() -> None:
    config = RadarConfig(range_resolution_m=0.05, range_offset_m=-0.31)
    assert decode_polar_image(**fields(powers(), config=config)).range_offset_m == -0.31


@pytest.mark.parametrize(
    ('changes', 'cause'),
    [
        ({'encoding': 'bgr8'}, 'wrong_encoding'),
        ({'encoding': '16UC1'}, 'wrong_encoding'),
        ({'height': 0}, 'empty_image'),
        ({'width': 0, 'step': 0}, 'empty_image'),
        ({'height': 20000, 'width': 15000, 'step': 15000}, 'image_too_large'),
        ({'step': 49}, 'short_step'),
        ({'data': b''}, 'short_data'),
        ({'data': b'\x01' * 19999}, 'short_data'),
        ({'data': bytes(20000)}, 'no_signal'),
        ({'config': RadarConfig()}, 'unknown_range_resolution'),
        ({'config': RadarConfig(range_resolution_m=0.05, metadata_columns='11')}, 'no_metadata'),
        ({'config': RadarConfig(metadata_columns='11'), 'width': 9, 'step': 50}, 'no_metadata'),
    ],
)
def test_invalid_images_are_refused_with_their_cause(changes: dict[str, Any], cause: str) -> None:
    with pytest.raises(RefusedInput) as refused:
        decode_polar_image(**fields(powers(), **changes))
    assert refused.value.cause == cause
    assert '\n' not in str(refused.value)


def test_a_recorded_message_of_a_driver_is_decoded(live_image: dict[str, Any]) -> None:
    scan = decode_polar_image(**live_image, config=RadarConfig())
    assert scan.power.shape == (400, 6848)
    assert scan.max_range_m == pytest.approx(300.0, abs=0.1)
    assert bytes(scan.power[:2].tobytes()) == bytes(live_image['data'])[: 2 * 6848]
