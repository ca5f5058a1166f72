"""MulRan, in the two image layouts of its radar: polar_oxford_form (metadata columns, ns) and bare polar.

The power in both is the same byte for byte. Bare polar has no encoder counts: its row k is taken at ``k · 2π / 400``,
while polar_oxford_form has it 7 counts of 5600 (0.45°) further; `radar.azimuth_offset_rad` = 0.00785 aligns them.
"""

from __future__ import annotations

from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.recordings.datasets.folders import (
    files_of,
    first_folder,
    have_metadata,
    named_by_stamp,
    sequence_folder,
    shape_of,
)
from offradar_ros.recordings.datasets.mulran_stamps import polar_stamps, stamp_list_differences
from offradar_ros.recordings.datasets.position_file import PositionFile, present
from offradar_ros.recordings.datasets.positions import read_global_pose, read_mulran_gps, read_radar_utm
from offradar_ros.recordings.datasets.sequence import RecordedSequence, in_stamp_order
from offradar_ros.recordings.datasets.stamped_png import metadata_reader, stamps_of, transposed_reader

LOOKS_FOR_OXFORD_FORM = 'polar_oxford_form/<ns>.png, also under sensor_data/radar/ (MulRan)'
LOOKS_FOR_POLAR = 'polar/<ns>.png, also under sensor_data/radar/ (MulRan, rows = range)'
_PARENTS = ('', 'sensor_data/radar/', 'radar/', 'sensor_data/')
_FOLDERS = ('polar', 'polar_oxford_form', 'ray', 'radar', 'sensor_data')
_POLAR_SIZE = (3360, 400)


def candidate_folders(name: str) -> tuple[str, ...]:
    """Where a folder of scans may lie under a sequence, in the download and for the file player."""
    return tuple(parent + name for parent in _PARENTS)


def locate_oxford_form(path: Path) -> Path | None:
    """The folder of scans with metadata columns."""
    folder = first_folder(path, candidate_folders('polar_oxford_form'), '.png')
    if folder is not None:
        return folder
    files = files_of(path, '.png')
    in_ns = named_by_stamp(files) and len(files[0].stem) >= 19
    return path if in_ns and have_metadata(files) else None


def locate_polar(path: Path) -> Path | None:
    """The folder of scans whose rows are ranges."""
    folder = first_folder(path, candidate_folders('polar'), '.png')
    if folder is None and shape_of(files_of(path, '.png')) == _POLAR_SIZE:
        return path
    return folder


def open_oxford_form(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`."""
    files = files_of(folder, '.png')
    stamps, warnings = stamps_of(files, radar)
    ordered, stamps_ns = in_stamp_order(files, stamps)
    root = sequence_folder(folder, _FOLDERS)
    return RecordedSequence(
        name=root.name,
        layout='mulran',
        root=root,
        files=ordered,
        stamps_ns=stamps_ns,
        read_scan=metadata_reader(radar),
        position_files=position_files(root),
        warnings=(*warnings, *stamp_list_differences(files, root)),
    )


def open_polar(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`."""
    files = files_of(folder, '.png')
    root = sequence_folder(folder, _FOLDERS)
    stamps, warnings = polar_stamps(files, root, radar)
    ordered, stamps_ns = in_stamp_order(files, stamps)
    return RecordedSequence(
        name=root.name,
        layout='mulran_polar',
        root=root,
        files=ordered,
        stamps_ns=stamps_ns,
        read_scan=transposed_reader(radar),
        position_files=position_files(root),
        warnings=(*warnings, *stamp_list_differences(files, root)),
        remarks=_polar_remarks(root),
    )


def _polar_remarks(root: Path) -> tuple[str, ...]:
    """What the scans do not say where only bare polar is there."""
    if first_folder(root, candidate_folders('polar_oxford_form'), '.png') is not None:
        return ()
    remark = (
        'polar without polar_oxford_form: the images say neither azimuths nor stamps of their rows, which are taken to '
        'be 0.9° apart from 0°, 0.45° before those of polar_oxford_form (radar.azimuth_offset_rad: 0.00785 aligns them)'
    )
    if first_folder(root, candidate_folders('ray'), '.csv') is not None:
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
