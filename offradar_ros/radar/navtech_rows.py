"""The 11 bytes before each row's power in the PNG files of Oxford Radar RobotCar, MulRan, Boreas and UTIAS.

Layout of a row (Barnes et al., "The Oxford Radar RobotCar Dataset", 2020, and the files themselves):

========  =======================  ============================================================
bytes     type                     content
========  =======================  ============================================================
0 to 7    int64, little-endian     time of the azimuth since the Unix epoch, µs (Oxford, Boreas) or ns (MulRan)
8, 9      uint16, little-endian    encoder counts, clockwise from the sensor's forward axis
10        uint8                    whether the row was measured; each source uses it differently, so it is not read
11 ...    uint8                    power, one byte for each range bin
========  =======================  ============================================================
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.encoder_counts import (
    FEWEST_ROWS,
    KNOWN_SIZES,
    WAY_OUT,
    angles_of_counts,
    full_turn_counts,
    step_of,
)
from offradar_ros.radar.profiles import PROFILES
from offradar_ros.radar.row_stamps import RowStamps, sound_stamps, unit_ns
from offradar_ros.types import PolarScan

METADATA_BYTES = 11
# With fewer rows, stamps and counts must both be sound for the bytes to be recognised as such.
_ENOUGH_ROWS = 16
_USUAL_ROWS = 400
_ROTATION_UNITS = 30 * 10**9
_MOST = 0.75


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """What the sensor says about a scan's rows, mended.

    Attributes:
        angles_rad: (A,) float64 in [0, 2π), clockwise from the encoder's zero.
        stamps_ns: (A,) int64, or None where the rows have no usable stamps.
        faults: number of rows by what was wrong with them and has been mended.
    """

    angles_rad: NDArray[np.float64]
    stamps_ns: NDArray[np.int64] | None
    faults: dict[str, int]


def _columns(image: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Stamps as stored and encoder counts, (A,) int64 each."""
    stamps = np.ascontiguousarray(image[:, :8]).view('<i8')[:, 0].astype(np.int64)
    encoders = np.ascontiguousarray(image[:, 8:10]).view('<u2')[:, 0].astype(np.int64)
    return stamps, encoders


def has_metadata(image: NDArray[np.uint8]) -> bool:
    """Whether each row of an (A, W) image starts with stamp, encoder and valid byte, found by content, not by size.

    Either is enough where most rows agree: stamps in order within a rotation, of any year from 2000 to 2038; or counts
    that advance by equal steps, beside stamps of one clock, set or not, or over a turn of a known size. So an image
    whose counts or stamps are useless is still recognised, and its 11 bytes are never power. Rows without both were not
    measured.
    """
    if image.ndim != 2 or image.shape[1] <= METADATA_BYTES or image.shape[0] < FEWEST_ROWS:
        return False
    stamps, counts = _columns(image)
    rows = np.flatnonzero((stamps != 0) | (counts != 0))
    if len(rows) < FEWEST_ROWS:
        return False
    median = float(np.partition(stamps[rows], len(rows) // 2)[len(rows) // 2])
    of_one_clock = np.abs(stamps[rows].astype(np.float64) - median) <= _ROTATION_UNITS
    if 2 * np.count_nonzero(of_one_clock) <= len(rows):
        step = step_of(counts[rows], rows)
        is_turn = step > 0.0 and full_turn_counts(step, len(image), KNOWN_SIZES[0], _USUAL_ROWS) is not None
        return is_turn and len(rows) >= _ENOUGH_ROWS and _advances(counts[rows], rows)
    # Rows of another clock have lost their metadata, and say nothing of the others.
    rows = rows[of_one_clock]
    timed = unit_ns(stamps[rows], None) is not None
    if len(rows) < _ENOUGH_ROWS:
        return timed and len(rows) >= FEWEST_ROWS and step_of(counts[rows], rows) > 0.0
    in_order = max(float(np.mean(np.diff(stamps[rows]) * sense > 0)) for sense in (1, -1))
    return _advances(counts[rows], rows) or (timed and in_order >= _MOST)


def _advances(counts: NDArray[np.int64], rows: NDArray[np.intp]) -> bool:
    """Whether the counts of most rows increase by about the same."""
    step = step_of(counts, rows)
    even = np.abs(np.diff(counts) / np.diff(rows) - step) <= max(1.0, step / 2.0)
    return step > 0.0 and float(np.mean(even)) >= _MOST


def may_hide_metadata(columns: int) -> bool:
    """Whether an image of this width is that of a known format and the 11 metadata columns."""
    known = {profile.range_bins for profile in PROFILES.values()}
    return columns - METADATA_BYTES in known and columns not in known


def is_turned(image: NDArray[np.uint8]) -> bool:
    """Whether the metadata columns are there, but not at the start of the rows: the image is turned or mirrored."""
    turned = (np.rot90(image, turns) for turns in (1, 2, 3))
    mirrored = (np.fliplr(image), image.T, np.rot90(image.T, 2))
    return any(has_metadata(np.asarray(view)) for view in (*turned, *mirrored))


def split_rows(
    image: NDArray[np.uint8], config: RadarConfig, scan_stamp_ns: int | None = None
) -> tuple[Rows, NDArray[np.uint8]]:
    """Split each row of an (A, 11 + R) uint8 image into its 11 bytes of metadata and its power, a view of the image.

    A row without stamp and encoder count was not measured: its azimuth and stamp are interpolated from the other rows.
    The valid byte is ignored: some sources write 0 everywhere or in every other row. `scan_stamp_ns` helps to tell
    what the stamps of the rows are.

    Raises RefusedInput with cause no_metadata, turned_image, or as `measured_rows`.
    """
    if image.shape[1] <= METADATA_BYTES:
        raise RefusedInput(
            'no_metadata', f'rows of {image.shape[1]} bytes cannot hold {METADATA_BYTES} metadata bytes and power'
        )
    stamps, counts = _columns(image)
    written = (stamps != 0) | (counts != 0)
    power = image[:, METADATA_BYTES:]
    try:
        rows = measured_rows(counts, stamps, written, power, config, scan_stamp_ns)
    except RefusedInput as refusal:
        raise _explained(refusal, image) from None
    return rows, power


def measured_rows(
    counts: NDArray[np.int64],
    stamps: NDArray[np.int64] | None,
    written: NDArray[np.bool_],
    power: NDArray[np.uint8],
    config: RadarConfig,
    scan_stamp_ns: int | None,
) -> Rows:
    """Angles and stamps of (A,) rows from what the sensor wrote of them, whatever form that came in.

    Rows that are not `written` have neither count nor stamp; if their `power` is zero, they were not measured. Wrong
    counts and stamps of a few rows are interpolated. Stamps of a clock that was never set are left out. With
    `radar.row_angles` equal, counts are ignored. `stamps` is None where the form has none. RefusedInput as
    `angles_of_counts`.
    """
    lost = int(np.count_nonzero(power[~written].any(axis=1)))
    if config.row_angles == 'equal':
        angles_rad, mended = equal_angles(len(counts), config), 0
    else:
        found = angles_of_counts(counts, written, config.encoder_size, config.azimuth_samples, lost)
        angles_rad, mended = found.angles_rad, found.mended
    timed = RowStamps(None) if stamps is None else sound_stamps(stamps, written, scan_stamp_ns, lost)
    faults = {'angle_interpolated': mended, 'stamp_interpolated': timed.mended}
    if stamps is not None and timed.stamps_ns is None:
        faults['stamp_unusable'] = len(counts)
    return Rows(angles_rad, timed.stamps_ns, {name: count for name, count in faults.items() if count})


def equal_angles(rows: int, config: RadarConfig) -> NDArray[np.float64]:
    """(A,) angles at equal steps from 0; an image with fewer rows than a rotation holds its first ones."""
    return np.arange(rows, dtype=np.float64) * (2 * np.pi / max(config.azimuth_samples, rows))


def _explained(refusal: RefusedInput, image: NDArray[np.uint8]) -> RefusedInput:
    """The refusal of an image's counts; a clearer one where there are none, or they are elsewhere."""
    if has_metadata(image):
        return refusal
    if is_turned(image):
        return RefusedInput(
            'turned_image',
            f'the image of {image.shape[0]} rows of {image.shape[1]} bytes is turned or mirrored: its metadata columns '
            'are not at the start of the rows; turn it back, so that each row is an azimuth and starts with its stamp',
        )
    _, counts = _columns(image)
    if _advances(counts, np.arange(len(counts))):
        return refusal
    as_power = f'set radar.metadata_columns to 0 if all {image.shape[1]} bytes are power, else '
    return RefusedInput(
        'no_metadata',
        f'the first {METADATA_BYTES} bytes of the {len(image)} rows hold neither stamps nor encoder counts: '
        f'{"" if may_hide_metadata(image.shape[1]) else as_power}{WAY_OUT}',
    )


def join_rows(scan: PolarScan, encoder_size: int) -> NDArray[np.uint8]:
    """The (A, 11 + R) uint8 image that `split_rows` reads back: ns stamps, encoder counts, valid 255, power.

    Azimuths are rounded to a count; in a scan without row stamps every row gets the scan's stamp.
    """
    rows, bins = scan.power.shape
    stamps = scan.azimuth_stamps_ns
    if stamps is None:
        stamps = np.full(rows, scan.stamp_ns, np.int64)
    counts = np.mod(np.rint(scan.azimuths_rad * (encoder_size / math.tau)), encoder_size)
    image = np.empty((rows, METADATA_BYTES + bins), np.uint8)
    image[:, :8] = stamps.astype('<i8').reshape(-1, 1).view(np.uint8)
    image[:, 8:10] = counts.astype('<u2').reshape(-1, 1).view(np.uint8)
    image[:, 10] = 255
    image[:, METADATA_BYTES:] = scan.power
    return image
