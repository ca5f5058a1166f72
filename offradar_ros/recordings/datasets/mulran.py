"""MulRan, in the two image layouts of its radar: polar_oxford_form (metadata columns, ns) and bare polar.

Power of both is the same byte for byte. Bare polar has no encoder: its row k is taken at ``k · 2π / 400``, while the
encoder of polar_oxford_form puts it 7 counts of 5600 (0.45°) further; `radar.azimuth_offset_rad` = 0.00785 aligns them.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.radar.png import decode_png
from offradar_ros.recordings.datasets.folders import (
    carry_metadata,
    climb,
    files_of,
    first_folder,
    named_by_stamp,
    shape_of,
)
from offradar_ros.recordings.datasets.mulran_stamps import polar_stamps, unlisted
from offradar_ros.recordings.datasets.position_file import PositionFile, present
from offradar_ros.recordings.datasets.positions import read_global_pose, read_mulran_gps, read_radar_utm
from offradar_ros.recordings.datasets.sequence import RecordedSequence, in_stamp_order
from offradar_ros.recordings.datasets.stamped_png import metadata_reader, stamps_of

LOOKS_FOR_OXFORD_FORM = 'polar_oxford_form/<ns>.png, also under sensor_data/radar/ (MulRan)'
LOOKS_FOR_POLAR = 'polar/<ns>.png, also under sensor_data/radar/ (MulRan, rows = range)'
_ABOVE = ('', 'sensor_data/radar/', 'radar/', 'sensor_data/')
_FOLDERS = ('polar', 'polar_oxford_form', 'ray', 'radar', 'sensor_data')
_POLAR_SIZE = (3360, 400)


def places(name: str) -> tuple[str, ...]:
    """Where a folder of scans is found under a sequence, as the download and as the file player have it."""
    return tuple(above + name for above in _ABOVE)


def locate_oxford_form(path: Path) -> Path | None:
    """The folder of scans with metadata columns."""
    folder = first_folder(path, places('polar_oxford_form'), '.png')
    if folder is not None:
        return folder
    files = files_of(path, '.png')
    in_ns = named_by_stamp(files) and len(files[0].stem) >= 19
    return path if in_ns and carry_metadata(files) else None


def locate_polar(path: Path) -> Path | None:
    """The folder of scans whose rows are ranges."""
    folder = first_folder(path, places('polar'), '.png')
    if folder is None and shape_of(files_of(path, '.png')) == _POLAR_SIZE:
        return path
    return folder


def open_oxford_form(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`."""
    files = files_of(folder, '.png')
    stamps, warnings = stamps_of(files, radar)
    ordered, stamps_ns = in_stamp_order(files, stamps)
    root = climb(folder, _FOLDERS)
    return RecordedSequence(
        name=root.name,
        layout='mulran',
        root=root,
        files=ordered,
        stamps_ns=stamps_ns,
        read_scan=metadata_reader(radar),
        position_files=position_files(root),
        warnings=(*warnings, *unlisted(files, root)),
    )


def open_polar(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`."""
    files = files_of(folder, '.png')
    root = climb(folder, _FOLDERS)
    stamps, warnings = polar_stamps(files, root, radar)
    ordered, stamps_ns = in_stamp_order(files, stamps)
    settled = dataclasses.replace(
        radar,
        azimuth_axis='columns' if radar.azimuth_axis == 'auto' else radar.azimuth_axis,
        metadata_columns='0' if radar.metadata_columns == 'auto' else radar.metadata_columns,
    )
    return RecordedSequence(
        name=root.name,
        layout='mulran_polar',
        root=root,
        files=ordered,
        stamps_ns=stamps_ns,
        read_scan=lambda path, stamp_ns: decode_png(path, stamp_ns, settled),
        position_files=position_files(root),
        warnings=(*warnings, *unlisted(files, root)),
        remarks=_lacks(root),
    )


def _lacks(root: Path) -> tuple[str, ...]:
    """What it means that only bare polar is there."""
    if first_folder(root, places('polar_oxford_form'), '.png') is not None:
        return ()
    remark = (
        'polar without polar_oxford_form: the images say neither azimuths nor stamps of their rows, which are taken to '
        'be 0.9° apart from 0°, 0.45° before those of polar_oxford_form (radar.azimuth_offset_rad: 0.00785 aligns them)'
    )
    if first_folder(root, places('ray'), '.csv') is not None:
        remark += '; ray has both: --layout mulran_ray reads that'
    return (remark,)


def position_files(root: Path) -> tuple[PositionFile, ...]:
    """Ground truth first, then tables of UTM positions, then the receiver."""
    return present(
        PositionFile('global pose', root / 'global_pose.csv', read_global_pose),
        *(PositionFile('UTM positions', path, read_radar_utm) for path in sorted(root.glob('*_radar_utm.csv'))),
        PositionFile('GPS', root / 'sensor_data' / 'gps.csv', read_mulran_gps),
        PositionFile('GPS', root / 'gps.csv', read_mulran_gps),
    )
