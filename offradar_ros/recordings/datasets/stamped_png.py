"""Scans as PNG files, most with metadata columns: Oxford, MulRan, RADIATE, Boreas, UTIAS.

Convention: a scan's stamp is its file name. In Oxford that is the time of the first row; elsewhere it may be another
row's. A file that is not named by a stamp gets the time of its first row.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.radar.navtech_rows import split_rows
from offradar_ros.radar.png import decode_png, read_gray_png
from offradar_ros.recordings.datasets.stamp_names import stamp_of_name
from offradar_ros.types import PolarScan

ASSUMED_PERIOD_NS = 250_000_000


def metadata_reader(radar: RadarConfig) -> Callable[[Path, int], PolarScan]:
    """Decodes files with rows = azimuths and metadata columns, unless `radar` says otherwise."""
    return _reader(radar, azimuth_axis='rows', metadata_columns='11')


def transposed_reader(radar: RadarConfig) -> Callable[[Path, int], PolarScan]:
    """Decodes files with rows = range and no metadata, unless `radar` says otherwise."""
    return _reader(radar, azimuth_axis='columns', metadata_columns='0')


def _reader(radar: RadarConfig, azimuth_axis: str, metadata_columns: str) -> Callable[[Path, int], PolarScan]:
    """A function of (file, stamp in ns); the layout's values take the place of `auto`."""
    resolved = dataclasses.replace(
        radar,
        azimuth_axis=azimuth_axis if radar.azimuth_axis == 'auto' else radar.azimuth_axis,
        metadata_columns=metadata_columns if radar.metadata_columns == 'auto' else radar.metadata_columns,
    )
    return lambda path, stamp_ns: decode_png(path, stamp_ns, resolved)


def first_row_stamp(path: Path, radar: RadarConfig) -> int | None:
    """Time of the first row; None where the file cannot be read, or has none that can be used."""
    try:
        rows, _ = split_rows(read_gray_png(path, radar.max_image_bytes), radar)
    except (DataError, RefusedInput):
        return None
    return None if rows.stamps_ns is None else int(rows.stamps_ns[0])


def stamps_of(files: Sequence[Path], radar: RadarConfig) -> tuple[list[int], list[str]]:
    """A stamp for each file, and what had to be assumed."""
    stamps: list[int] = []
    warnings: list[str] = []
    for file in files:
        stamp = stamp_of_name(file)
        if stamp is None:
            stamp = first_row_stamp(file, radar)
        if stamp is None:
            stamp = stamps[-1] + ASSUMED_PERIOD_NS if stamps else 0
            warnings.append(f'{file}: neither its name nor its rows give a stamp: assumed 0.25 s after the one before')
        stamps.append(stamp)
    return stamps, warnings
