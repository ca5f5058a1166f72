"""Oxford Radar RobotCar: gps/gps.csv (receiver) and gps/ins.csv (fused with the inertial unit), stamps in µs."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from pathlib import Path

import numpy as np

from offradar_ros.geometry import Trajectory, wrap_angle
from offradar_ros.recordings.datasets.positions.table import named_rows
from offradar_ros.recordings.datasets.positions.track import Track

GOOD_STATUS = 'INS_SOLUTION_GOOD'


def read_oxford_gps(path: Path, tally: Counter[str] | None = None) -> Trajectory:
    """Geodetic positions of gps.csv, yaw unknown. DataError for a damaged file."""
    track = Track(path, tally)
    for row in named_rows(path, ('timestamp', 'latitude', 'longitude', 'altitude')):
        track.add_geodetic(row, row.stamp_ns(), (row.number(1), row.number(2), row.number(3)))
    return track.geodetic()


def read_oxford_ins(path: Path, tally: Counter[str] | None = None) -> Trajectory:
    """Geodetic positions and yaw of ins.csv where the status is INS_SOLUTION_GOOD; others are tallied by status.

    The file's yaw is a heading, radians clockwise from north.
    """
    track = Track(path, tally)
    headings: dict[int, float] = {}
    for row in named_rows(path, ('timestamp', 'ins_status', 'latitude', 'longitude', 'altitude', 'yaw')):
        if row.cells[1] != GOOD_STATUS:
            track.leave_out(f'status {row.cells[1] or "missing"}')
            continue
        stamp_ns = row.stamp_ns()
        track.add_geodetic(row, stamp_ns, (row.number(2), row.number(3), row.number(4)))
        headings.setdefault(stamp_ns, row.finite(5))
    trajectory = track.geodetic()
    yaws = np.array([math.pi / 2 - headings[int(stamp)] for stamp in trajectory.stamps_ns], np.float64)
    return dataclasses.replace(trajectory, yaws_rad=wrap_angle(yaws))
