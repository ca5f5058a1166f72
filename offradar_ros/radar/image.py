"""A polar image, live from a driver or decoded from a file, to a PolarScan. All differences between images are here.

Convention: power is (azimuths, range_bins); row k of an image without metadata columns is azimuth
``azimuth_offset ± k · 2π / azimuth_samples``, clockwise from forward unless `radar.azimuth_direction` says otherwise.
With metadata columns the azimuth comes from the row's encoder count instead.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.navtech_rows import (
    METADATA_BYTES,
    Rows,
    equal_angles,
    has_metadata,
    is_turned,
    may_hide_metadata,
    split_rows,
)
from offradar_ros.radar.profiles import range_resolution
from offradar_ros.types import PolarScan

ENCODINGS = ('8UC1', 'mono8')
_LARGEST_POWER = 255
_FEW_MISSING = 0.02
"""A share of a rotation that some drivers leave out of a scan."""
_LEAST_SIGHT = 0.25
"""Share of a rotation that must show something; sectors that look at the vehicle itself are blanked in some."""


def decode_polar_image(
    data: Any, *, height: int, width: int, step: int, encoding: str, stamp_ns: int, config: RadarConfig
) -> PolarScan:
    """One scan from the fields of a sensor_msgs/Image, or from the same fields of a decoded PNG.

    `data` is any buffer of bytes (bytes, array.array, memoryview, uint8 ndarray): `height` rows of `step` bytes, whose
    first `width` bytes are pixels. The power of the result is a view of it where azimuths are rows, and a transposed
    copy where they are columns.

    Raises RefusedInput with cause wrong_encoding, empty_image, image_too_large, short_step, short_data, no_signal
    (every byte is zero), too_few_rows (in most, power does not change with range), unknown_range_resolution,
    unreadable_metadata (the 11 bytes are there, but useless), or as `split_rows`.
    """
    _check_fields(height, width, step, encoding, config.max_image_bytes)
    image = _pixels(data, height, width, step)
    if _starts_with_metadata(image, config):
        rows, power = split_rows(image, config, stamp_ns)
        return scan_from_rows(power, rows, stamp_ns, config)
    if _azimuths_are_columns(image, config):
        image = np.asarray(cv2.transpose(image), np.uint8)
    if config.metadata_columns == 'auto':
        _require_no_metadata(image)
    missing = max(0, config.azimuth_samples - len(image))
    faults = {'missing': missing if missing > _FEW_MISSING * config.azimuth_samples else 0}
    rows = Rows(equal_angles(len(image), config), None, faults)
    return scan_from_rows(image, rows, stamp_ns, config)


def _starts_with_metadata(image: NDArray[np.uint8], config: RadarConfig) -> bool:
    if config.metadata_columns == 'auto':
        return config.azimuth_axis != 'columns' and has_metadata(image)
    return config.metadata_columns == '11'


def _require_no_metadata(image: NDArray[np.uint8]) -> None:
    """RefusedInput if rows of power hold the metadata columns after all, where they cannot be read."""
    if may_hide_metadata(image.shape[1]):
        raise RefusedInput(
            'unreadable_metadata',
            f'rows of {image.shape[1]} bytes are {METADATA_BYTES} more than those of a known format, but do not start '
            f'with stamps and encoder counts that can be read: set radar.metadata_columns to 0 if all are power, or to '
            '11 and radar.row_angles to equal if the first 11 are not',
        )
    if has_metadata(image) or is_turned(image):
        raise RefusedInput(
            'turned_image',
            f'the image of {image.shape[0]} rows of {image.shape[1]} bytes is turned or mirrored: its metadata columns '
            'are not at the start of the rows; turn it back, or set radar.metadata_columns to 0 if all is power',
        )


def scan_from_rows(power: NDArray[np.uint8], rows: Rows, stamp_ns: int, config: RadarConfig) -> PolarScan:
    """A scan from (A, R) power and what the sensor says about the rows, with the geometry of `config`.

    RefusedInput with cause no_signal, too_few_rows or unknown_range_resolution.
    """
    strongest, weakest = power.max(axis=1, initial=0), power.min(axis=1, initial=_LARGEST_POWER)
    if not strongest.any():
        raise RefusedInput('no_signal', f'scan at {stamp_ns} ns holds no signal: every power value is zero')
    resolution_m = range_resolution(config, power.shape[1])
    if weakest.min() == strongest.max():
        raise RefusedInput('no_signal', f'scan at {stamp_ns} ns holds no signal: every power value is {strongest[0]}')
    _require_sight(int(np.count_nonzero(strongest > weakest)), max(len(power), config.azimuth_samples), stamp_ns)
    faults = rows.faults | {
        'no_power': int(np.count_nonzero(strongest == 0)),
        'saturated': int(np.count_nonzero(weakest == _LARGEST_POWER)),
    }
    sense = 1.0 if config.azimuth_direction == 'clockwise' else -1.0
    azimuths_rad = np.mod(config.azimuth_offset_rad + sense * rows.angles_rad, 2 * np.pi)
    azimuths_rad[azimuths_rad >= 2 * np.pi] = 0.0  # mod of a tiny negative angle rounds up to a full turn
    stamps_ns = rows.stamps_ns
    if 'stamp_unusable' in faults:
        stamps_ns = np.full(len(power), stamp_ns, np.int64)
    return PolarScan(
        stamp_ns=stamp_ns,
        power=power,
        azimuths_rad=azimuths_rad,
        range_resolution_m=resolution_m,
        range_offset_m=config.range_offset_m,
        azimuth_stamps_ns=stamps_ns,
        row_faults={name: count for name, count in faults.items() if count},
    )


def _require_sight(rows: int, rotation: int, stamp_ns: int) -> None:
    """RefusedInput where too few rows show anything: the place of such a scan cannot be told from others."""
    if rows < _LEAST_SIGHT * rotation:
        raise RefusedInput(
            'too_few_rows',
            f'scan at {stamp_ns} ns: in {rows} of the {rotation} rows of a rotation power changes with range: expected '
            f'at least {math.ceil(_LEAST_SIGHT * rotation)}; the radar is blocked or saturated, the rotation was cut '
            'off, or radar.azimuth_samples is that of another sensor',
        )


def _check_fields(height: int, width: int, step: int, encoding: str, max_bytes: int) -> None:
    if encoding not in ENCODINGS:
        raise RefusedInput(
            'wrong_encoding', f'polar image has encoding {encoding!r}: expected one of {", ".join(ENCODINGS)}'
        )
    if height <= 0 or width <= 0:
        raise RefusedInput('empty_image', f'polar image is empty: {height} rows of {width} columns')
    if step < width:
        raise RefusedInput(
            'short_step', f'polar image has a step of {step} bytes: expected at least its width, {width}'
        )
    if height * step > max_bytes:
        raise RefusedInput(
            'image_too_large',
            f'polar image of {height} rows of {step} bytes is over radar.max_image_bytes = {max_bytes}',
        )


def _pixels(data: Any, height: int, width: int, step: int) -> NDArray[np.uint8]:
    """(height, width) uint8 view of the buffer."""
    flat = np.frombuffer(data, np.uint8)
    needed = (height - 1) * step + width  # the last row may come without its padding
    if flat.size < needed:
        raise RefusedInput(
            'short_data', f'polar image holds {flat.size} bytes: expected {height} rows of {step}, {height * step}'
        )
    return np.lib.stride_tricks.as_strided(flat, (height, width), (step, 1), writeable=False)


def _azimuths_are_columns(image: NDArray[np.uint8], config: RadarConfig) -> bool:
    if config.azimuth_axis != 'auto':
        return config.azimuth_axis == 'columns'
    rows, columns = (int(n) for n in image.shape)
    if config.azimuth_samples in (rows, columns):
        return rows != config.azimuth_samples
    # A radar has more range bins than azimuths, and a partial rotation has still fewer azimuths.
    return columns < rows
