"""MulRan's ray form, which KAIST01 has in place of polar_oxford_form: a CSV file a scan, a line an azimuth.

Columns: stamp in ns, azimuth in degrees clockwise (encoder · 360 / 5600), encoder, counter, then the powers. The file
is named by the stamp of its last line.
"""

from __future__ import annotations

import codecs
import dataclasses
import math
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.bounded_input import read_bounded
from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.encoder_counts import LARGEST_SHARE_MENDED
from offradar_ros.radar.image import scan_from_rows
from offradar_ros.radar.navtech_rows import measured_rows
from offradar_ros.recordings.datasets.folders import files_of, first_folder, sequence_folder
from offradar_ros.recordings.datasets.mulran import candidate_folders, position_files
from offradar_ros.recordings.datasets.sequence import RecordedSequence, in_stamp_order
from offradar_ros.recordings.datasets.stamp_names import stamp_of_name
from offradar_ros.types import PolarScan

LOOKS_FOR = '<ns>.csv, one a scan, also under ray/ or sensor_data/radar/ray/ (MulRan ray form)'
_LEADING = 4
_FEWEST_COLUMNS = 64
_LARGEST_COUNT = 65535
_FIRST_SCANS = 5
_MOST_READ = 2**18
# As text, and some for stamp and angle of the row.
_BYTES_OF_A_VALUE = 5
_REMARKS = (
    'ray without polar_oxford_form: nothing is missing, azimuths and stamps of rows are in the files, but text is read '
    'slowly, and a scan has the stamp of its last row (offradar convert makes a bag of it)',
)


def locate(path: Path) -> Path | None:
    """The folder of scans, if this is the layout."""
    folder = first_folder(path, candidate_folders('ray'), '.csv') or path
    scans = _scan_files(folder)
    return folder if any(_is_ray(scan) for scan in scans[:_FIRST_SCANS]) else None


def _scan_files(folder: Path) -> list[Path]:
    return [file for file in files_of(folder, '.csv') if stamp_of_name(file) is not None]


def _is_ray(path: Path) -> bool:
    """Whether one of the first lines has as many columns as a scan has range bins; the others may be damaged."""
    try:
        if not path.is_file():
            return False
        with path.open('rb') as file:
            return any(line.count(b',') >= _FEWEST_COLUMNS for line in file.read(_MOST_READ).splitlines())
    except OSError:
        return False


def open_ray(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`."""
    found = _scan_files(folder)
    files, stamps_ns = in_stamp_order(found, [stamp_of_name(file) or 0 for file in found])
    root = sequence_folder(folder, ('ray', 'radar', 'sensor_data'))
    return RecordedSequence(
        name=root.name,
        layout='mulran_ray',
        root=root,
        files=files,
        stamps_ns=stamps_ns,
        read_scan=lambda path, stamp_ns: read_ray_scan(path, stamp_ns, radar),
        position_files=position_files(root),
        remarks=_REMARKS,
    )


def read_ray_scan(path: Path, stamp_ns: int, radar: RadarConfig) -> PolarScan:
    """One scan of a ray file; a damaged line is a row without power.

    DataError names the first line that is damaged if more than `LARGEST_SHARE_MENDED` are; RefusedInput as
    `measured_rows` and `scan_from_rows`.
    """
    try:
        # A byte that is no text damages its line only.
        content = read_bounded(path, _BYTES_OF_A_VALUE * radar.max_image_bytes)
        text = content.removeprefix(codecs.BOM_UTF8).decode('ascii', errors='replace')
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from None
    lines = text.splitlines()
    while len(lines) > radar.azimuth_samples and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise DataError(f'{path}: empty file: expected a line an azimuth')
    columns = Counter(line.count(',') + 1 for line in lines).most_common(1)[0][0]
    stamps, counts = np.zeros(len(lines), np.int64), np.zeros(len(lines), np.int64)
    power = np.zeros((len(lines), max(columns - _LEADING, 0)), np.uint8)
    sound = np.zeros(len(lines), np.bool_)
    damage: list[str] = []
    for row, line in enumerate(lines):
        try:
            stamps[row], counts[row], power[row] = _row_of(line, columns, radar.encoder_size)
            sound[row] = True
        except (ValueError, OverflowError) as error:
            damage.append(f'{path}, line {row + 1}: {error}')
    if len(damage) > max(1.0, LARGEST_SHARE_MENDED * len(lines)):
        raise DataError(f'{damage[0]} ({len(damage)} of {len(lines)} lines are damaged)')
    try:
        rows = measured_rows(counts, stamps, sound, power, radar, stamp_ns)
        if damage:
            rows = dataclasses.replace(rows, faults=rows.faults | {'damaged': len(damage)})
        return scan_from_rows(power, rows, stamp_ns, radar)
    except RefusedInput as refusal:
        raise RefusedInput(refusal.cause, f'{path}: {refusal}') from None


def _row_of(line: str, columns: int, encoder_size: int) -> tuple[int, int, NDArray[np.int64]]:
    """Stamp in ns, encoder count and powers of a line; ValueError says what is wrong with it."""
    cells = line.split(',')
    if len(cells) != columns or columns <= _LEADING:
        raise ValueError(f'expected stamp, azimuth, encoder, counter and powers in {columns} columns, got {len(cells)}')
    azimuth_deg, powers = float(cells[1]), np.array(cells[_LEADING:]).astype(np.int64)
    if powers.min() < 0 or powers.max() > 255 or not math.isfinite(azimuth_deg):
        raise ValueError('expected a finite azimuth and powers of 0 to 255')
    # The azimuth was computed from the encoder; a row whose encoder is missing may still have it.
    count = int(cells[2]) or round(azimuth_deg * encoder_size / 360.0)
    if not 0 <= count <= _LARGEST_COUNT:
        raise ValueError(f'expected an encoder count of 0 to {_LARGEST_COUNT}, got {count}')
    return int(cells[0]), count, powers
