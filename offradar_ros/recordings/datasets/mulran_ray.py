"""MulRan's ray form, which KAIST01 has in place of polar_oxford_form: a CSV file a scan, a line an azimuth.

Columns: stamp in ns, azimuth in degrees clockwise (encoder · 360 / 5600), encoder, counter, then the powers. The file
is named by the stamp of its last line.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.image import scan_from_rows
from offradar_ros.recordings.datasets.folders import files_of, first_folder, lines_of, sequence_folder
from offradar_ros.recordings.datasets.mulran import candidate_folders, position_files
from offradar_ros.recordings.datasets.sequence import RecordedSequence, in_stamp_order
from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns, stamp_of_name
from offradar_ros.types import PolarScan

LOOKS_FOR = '<ns>.csv, one a scan, also under ray/ or sensor_data/radar/ray/ (MulRan ray form)'
_LEADING = 4
_FEWEST_COLUMNS = 64
_REMARKS = (
    'ray without polar_oxford_form: nothing is missing, azimuths and stamps of rows are in the files, but text is read '
    'slowly, and a scan has the stamp of its last row (offradar convert makes a bag of it)',
)


def locate(path: Path) -> Path | None:
    """The folder of scans, if this is the layout."""
    folder = first_folder(path, candidate_folders('ray'), '.csv') or path
    scans = _scan_files(folder)
    return folder if scans and _is_ray(scans[0]) else None


def _scan_files(folder: Path) -> list[Path]:
    return [file for file in files_of(folder, '.csv') if stamp_of_name(file) is not None]


def _is_ray(path: Path) -> bool:
    try:
        with path.open(encoding='ascii') as file:
            return file.readline().count(',') >= _FEWEST_COLUMNS
    except (OSError, UnicodeDecodeError):
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
    """One scan of a ray file. DataError names the line that is damaged; RefusedInput as `scan_from_rows`."""
    lines = lines_of(path, 'ascii')
    if not lines:
        raise DataError(f'{path}: empty file: expected a line an azimuth')
    columns = lines[0].count(',') + 1
    stamps = np.empty(len(lines), np.int64)
    angles = np.empty(len(lines), np.float64)
    power = np.empty((len(lines), max(columns - _LEADING, 0)), np.uint8)
    for row, line in enumerate(lines):
        cells = line.split(',')
        if len(cells) != columns or columns <= _LEADING:
            raise DataError(
                f'{path}, line {row + 1}: expected stamp, azimuth, encoder, counter and powers in {columns} columns, '
                f'got {len(cells)}'
            )
        try:
            stamps[row] = parse_stamp_ns(cells[0])
            angles[row] = np.radians(float(cells[1]))
            powers = np.array(cells[_LEADING:]).astype(np.int64)
        except (ValueError, OverflowError) as error:
            raise DataError(f'{path}, line {row + 1}: {error}') from None
        if powers.min() < 0 or powers.max() > 255 or not np.isfinite(angles[row]):
            raise DataError(f'{path}, line {row + 1}: expected a finite azimuth and powers of 0 to 255')
        power[row] = powers
    try:
        return scan_from_rows(power, angles, stamps, stamp_ns, radar)
    except RefusedInput as refusal:
        raise RefusedInput(refusal.cause, f'{path}: {refusal}') from None
