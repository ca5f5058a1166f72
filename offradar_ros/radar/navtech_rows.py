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

import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.types import PolarScan

METADATA_BYTES = 11
_ENCODER_SIZES = (5600, 16000, 65536)
_YEAR_2000_US, _YEAR_2100_US = 946_684_800_000_000, 4_102_444_800_000_000
_LONGEST_ROTATION_NS = 60 * 10**9
_FEWEST_ROWS = 4


def _columns(image: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Stamps as stored and encoder counts, (A,) int64 each."""
    stamps = np.ascontiguousarray(image[:, :8]).view('<i8')[:, 0].astype(np.int64)
    encoders = np.ascontiguousarray(image[:, 8:10]).view('<u2')[:, 0].astype(np.int64)
    return stamps, encoders


def _advances(encoders: NDArray[np.int64]) -> bool:
    """Whether the counts increase, with at most one wrap to zero, as over a rotation; one row in 50 may be wrong."""
    steps = np.diff(encoders)
    outliers = max(1, len(steps) // 50)
    return bool(len(steps) >= _FEWEST_ROWS - 1 and np.count_nonzero(steps <= 0) <= outliers)


def has_metadata(image: NDArray[np.uint8]) -> bool:
    """Whether each row of an (A, W) image starts with stamp, encoder and valid byte, found by content, not by size.

    Rows without a stamp (not measured, in a partial rotation) are ignored. At least four rows must have one.
    """
    if image.ndim != 2 or image.shape[1] <= METADATA_BYTES or image.shape[0] < _FEWEST_ROWS:
        return False
    stamps, encoders = _columns(image)
    measured = stamps != 0
    if np.count_nonzero(measured) < _FEWEST_ROWS:
        return False
    stamps, encoders = stamps[measured], encoders[measured]
    for scale in (1, 1000):
        if np.all((stamps > scale * _YEAR_2000_US) & (stamps < scale * _YEAR_2100_US)):
            steps = np.diff(stamps)
            rotation = int(stamps[-1] - stamps[0]) * (1000 // scale)
            return bool(np.all(steps >= 0)) and rotation < _LONGEST_ROTATION_NS and _advances(encoders)
    return False


def full_turn_counts(encoders: NDArray[np.int64], encoder_size: int) -> int:
    """Counts in a full turn: `encoder_size`, or, if a count is larger, the smallest known size above all counts."""
    largest = int(encoders.max(initial=0))
    if largest < encoder_size:
        return encoder_size
    return next(size for size in _ENCODER_SIZES if size > largest)


def split_rows(
    image: NDArray[np.uint8], encoder_size: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """Split each row of an (A, 11 + R) uint8 image into its 11 bytes of metadata and its power.

    Returns:
        azimuths_rad: (A,) float64 in [0, 2π), clockwise from the encoder's zero.
        azimuth_stamps_ns: (A,) int64; whether a file has µs or ns is recognised by their magnitude.
        power: (A, R) uint8, a view of the image.

    A row without stamp and encoder count was not measured: its azimuth and stamp are interpolated from the other rows.
    The valid byte is ignored: some sources write 0 everywhere or in every other row.
    RefusedInput('wrong_size') where the encoder counts do not increase.
    """
    if image.shape[1] <= METADATA_BYTES:
        raise RefusedInput(
            'wrong_size', f'rows of {image.shape[1]} bytes cannot hold {METADATA_BYTES} metadata bytes and power'
        )
    stamps, encoders = _columns(image)
    measured = (stamps != 0) | (encoders != 0)
    rows = np.flatnonzero(measured)
    if not _advances(encoders[rows]):
        raise RefusedInput(
            'wrong_size',
            f'the encoder counts in bytes 8 and 9 of the {len(image)} rows do not increase: '
            'set radar.metadata_columns to 0 if the rows hold power only',
        )
    size = full_turn_counts(encoders, encoder_size)
    turned = np.unwrap(encoders[rows].astype(np.float64), period=size)
    # The modulo is of counts, where the zero after a full turn is exact.
    azimuths = np.mod(_at_every_row(rows, turned, len(image)), size) * (2 * np.pi / size)
    stamps = np.rint(_at_every_row(rows, (stamps[rows] - stamps[rows[0]]).astype(np.float64), len(image))).astype(
        np.int64
    ) + int(stamps[rows[0]])
    if int(stamps[rows[0]]) < 1000 * _YEAR_2000_US:
        stamps *= 1000
    return azimuths, stamps, image[:, METADATA_BYTES:]


def _at_every_row(rows: NDArray[np.intp], values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(`count`,) values at every row: interpolated between `rows`, and extrapolated beyond them by the mean step."""
    every = np.arange(count)
    step = (values[-1] - values[0]) / (rows[-1] - rows[0])
    line = values[0] + (every - rows[0]) * step
    inside = np.interp(every, rows, values)
    return np.asarray(np.where((every < rows[0]) | (every > rows[-1]), line, inside))


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
