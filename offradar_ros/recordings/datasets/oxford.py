"""Oxford Radar RobotCar: radar/<µs>.png, radar.timestamps, gps/gps.csv, gps/ins.csv."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.folders import (
    files_of,
    first_folder,
    have_metadata,
    lines_of,
    named_by_stamp,
    sequence_folder,
    shape_of,
)
from offradar_ros.recordings.datasets.listed_scans import listing_differences
from offradar_ros.recordings.datasets.position_file import PositionFile, present
from offradar_ros.recordings.datasets.positions import read_oxford_gps, read_oxford_ins
from offradar_ros.recordings.datasets.sequence import RecordedSequence, in_stamp_order
from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns
from offradar_ros.recordings.datasets.stamped_png import metadata_reader, stamps_of

LOOKS_FOR = 'radar/<µs>.png with radar.timestamps or gps/ beside radar/ (Oxford Radar RobotCar)'
_SIZE = (400, 3779)


def locate(path: Path) -> Path | None:
    """The folder of scans, if this is the layout."""
    folder = first_folder(path, ('radar',), '.png') or (path if files_of(path, '.png') else None)
    if folder is None:
        return None
    files = files_of(folder, '.png')
    is_named = named_by_stamp(files)
    root = sequence_folder(folder, ('radar',))
    if any((root / name).exists() for name in ('radar.timestamps', 'gps/gps.csv', 'gps/ins.csv')):
        # Files that were given other names have the stamps in their rows.
        return folder if is_named or have_metadata(files) else None
    return folder if is_named and shape_of(files) == _SIZE else None


def open_oxford(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`."""
    root = sequence_folder(folder, ('radar',))
    files = files_of(folder, '.png')
    stamps, warnings = stamps_of(files, radar)
    ordered, stamps_ns = in_stamp_order(files, stamps)
    return RecordedSequence(
        name=root.name,
        layout='oxford',
        root=root,
        files=ordered,
        stamps_ns=stamps_ns,
        read_scan=metadata_reader(radar),
        position_files=present(
            PositionFile('INS', root / 'gps' / 'ins.csv', read_oxford_ins),
            PositionFile('GPS', root / 'gps' / 'gps.csv', read_oxford_gps),
        ),
        warnings=(*warnings, *_listing_differences(root / 'radar.timestamps', files)),
    )


def _listing_differences(listing: Path, files: Sequence[Path]) -> list[str]:
    """How radar.timestamps and the files on disk disagree."""
    if not (listing.exists() and named_by_stamp(files)):
        return []
    try:
        listed = _listed_stamps(listing)
    except DataError as error:
        return [str(error)]
    return listing_differences(listing, listed, files, unit_ns=1000)


def _listed_stamps(listing: Path) -> list[int]:
    stamps = []
    for number, line in enumerate(lines_of(listing), start=1):
        if line.strip():
            try:
                stamps.append(parse_stamp_ns(line.split()[0]))
            except ValueError as error:
                raise DataError(f'{listing}, line {number}: expected "<stamp> <valid>": {error}') from None
    return stamps
