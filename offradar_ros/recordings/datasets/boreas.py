"""Boreas: radar/<µs>.png and applanix/radar_poses.csv; also any folder of PNG files with metadata columns (UTIAS)."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.recordings.datasets.folders import files_of, first_folder, have_metadata, sequence_folder
from offradar_ros.recordings.datasets.position_file import PositionFile, present
from offradar_ros.recordings.datasets.positions import read_radar_poses
from offradar_ros.recordings.datasets.sequence import RecordedSequence, in_stamp_order
from offradar_ros.recordings.datasets.stamped_png import metadata_reader, stamps_of

LOOKS_FOR = 'radar/<µs>.png with applanix/ beside radar/ (Boreas), or any PNG files with 11 metadata columns'


def locate(path: Path) -> Path | None:
    """The folder of scans, if this is the layout."""
    folder = first_folder(path, ('radar',), '.png') or (path if files_of(path, '.png') else None)
    if folder is None:
        return None
    is_boreas = (sequence_folder(folder, ('radar',)) / 'applanix').is_dir()
    return folder if is_boreas or have_metadata(files_of(folder, '.png')) else None


def open_boreas(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`."""
    root = sequence_folder(folder, ('radar',))
    files = files_of(folder, '.png')
    stamps, warnings = stamps_of(files, radar)
    ordered, stamps_ns = in_stamp_order(files, stamps)
    return RecordedSequence(
        name=root.name,
        layout='boreas',
        root=root,
        files=ordered,
        stamps_ns=stamps_ns,
        read_scan=metadata_reader(radar),
        position_files=present(PositionFile('poses', root / 'applanix' / 'radar_poses.csv', read_radar_poses)),
        warnings=tuple(warnings),
    )
