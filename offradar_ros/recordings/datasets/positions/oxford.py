"""Oxford Radar RobotCar: gps/gps.csv (receiver) and gps/ins.csv (fused with the inertial unit), stamps in µs."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.positions.table import named_rows
from offradar_ros.recordings.datasets.positions.track import Track

GOOD_STATUS = 'INS_SOLUTION_GOOD'
_LONGEST_STATUS = 40


def read_oxford_gps(path: Path, tally: Counter[str] | None = None) -> Trajectory:
    """Geodetic positions of gps.csv, yaw unknown. DataError for a damaged file."""
    track = Track(path, tally)
    for row in named_rows(path, ('timestamp', 'latitude', 'longitude', 'altitude')):
        with track.row(row):
            position = (row.number_or_nan(1), row.number_or_nan(2), row.number_or_nan(3))
            track.add_geodetic(track.stamp_ns(row), position)
    return track.trajectory()


def read_oxford_ins(path: Path, tally: Counter[str] | None = None) -> Trajectory:
    """Geodetic positions and yaw of ins.csv where the status is INS_SOLUTION_GOOD; others are tallied by status.

    The file's yaw is a heading, radians clockwise from north.
    """
    track = Track(path, tally)
    for row in named_rows(path, ('timestamp', 'ins_status', 'latitude', 'longitude', 'altitude', 'yaw')):
        with track.row(row):
            status = row.text(1)
            if status != GOOD_STATUS:
                track.leave_out(f'status {status[:_LONGEST_STATUS] or "missing"}')
                continue
            position = (row.number_or_nan(2), row.number_or_nan(3), row.number_or_nan(4))
            track.add_geodetic(track.stamp_ns(row), position, math.pi / 2 - row.finite(5))
    return track.trajectory()
