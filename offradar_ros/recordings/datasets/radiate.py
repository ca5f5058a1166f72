"""RADIATE: Navtech_Polar/<frame>.png (rows = range), stamps in Navtech_Polar.txt, positions in GPS_IMU_Twist."""

from __future__ import annotations

import itertools
from pathlib import Path

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.folders import files_of, first_folder, sequence_folder
from offradar_ros.recordings.datasets.position_file import PositionFile, present
from offradar_ros.recordings.datasets.positions import read_gps_twist
from offradar_ros.recordings.datasets.radiate_frames import read_frames
from offradar_ros.recordings.datasets.sequence import RecordedSequence, in_stamp_order
from offradar_ros.recordings.datasets.stamped_png import transposed_reader

LOOKS_FOR = 'Navtech_Polar/<frame>.png with Navtech_Polar.txt (RADIATE)'


def locate(path: Path) -> Path | None:
    """The folder of scans, if this is the layout."""
    return first_folder(path, ('Navtech_Polar',), '.png')


def open_radiate(folder: Path, radar: RadarConfig) -> RecordedSequence:
    """The sequence whose scans are in `folder`; the list's stamps are the scans' stamps."""
    root = sequence_folder(folder, ('Navtech_Polar',))
    listing = root / 'Navtech_Polar.txt'
    frames, damage = read_frames(listing)
    found = {file.stem: file for file in files_of(folder, '.png')}
    warnings = [f'{len(damage)} damaged lines in the list, first {damage[0]}'] if damage else []
    missing = [frame.name for frame in frames if frame.name not in found]
    if missing:
        warnings.append(f'{listing}: {len(missing)} of {len(frames)} listed scans have no file, first {missing[0]}.png')
    extra = sorted(set(found) - {frame.name for frame in frames})
    if extra:
        warnings.append(
            f'{listing}: {len(extra)} of {len(found)} files are not listed and have no stamp, first {extra[0]}.png'
        )
    backwards = [b.line for a, b in itertools.pairwise(frames) if b.stamp_ns < a.stamp_ns]
    if backwards:
        warnings.append(f'{listing}: stamps that go backwards: {len(backwards)}, first on line {backwards[0]}')
    kept = [frame for frame in frames if frame.name in found]
    if not kept:
        raise DataError(f'{listing}: none of the {len(frames)} listed scans has a file in {folder}')
    files, stamps_ns = in_stamp_order([found[frame.name] for frame in kept], [frame.stamp_ns for frame in kept])
    return RecordedSequence(
        name=root.name,
        layout='radiate',
        root=root,
        files=files,
        stamps_ns=stamps_ns,
        read_scan=transposed_reader(radar),
        position_files=present(PositionFile('GPS', root / 'GPS_IMU_Twist.txt', read_gps_twist)),
        warnings=tuple(warnings),
    )
