"""RADIATE: stamps in GPS_IMU_Twist.txt, one file a sample in GPS_IMU_Twist/, whose first line is the position."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.positions.table import Row, bare_rows
from offradar_ros.recordings.datasets.positions.track import Track
from offradar_ros.recordings.datasets.radiate_frames import read_frames


def read_gps_twist(path: Path, tally: Counter[str] | None = None) -> Trajectory:
    """Geodetic positions, yaw unknown. `path` is GPS_IMU_Twist.txt; the samples lie in the folder beside it.

    As published, two samples share each stamp and the clock is set back now and then: samples whose stamp is not after
    all earlier ones are left out and tallied, and so is a listed sample without a file.
    """
    track = Track(path, tally)
    frames, damage = read_frames(path)
    for error in damage:
        track.leave_out_damaged(error)
    for frame in frames:
        sample = path.parent / path.stem / f'{frame.name}.txt'
        if not sample.is_file():
            track.leave_out('missing sample')
            continue
        row = _first_line(sample)
        with track.row(row):
            position = (row.number_or_nan(0), row.number_or_nan(1), row.number_or_nan(2))
            track.add_geodetic(frame.stamp_ns, position)
    return track.trajectory()


def _first_line(sample: Path) -> Row:
    for row in bare_rows(sample, ('latitude', 'longitude', 'altitude')):
        return row
    return Row(sample, 1, (), (), 'empty file: expected latitude, longitude, altitude')
