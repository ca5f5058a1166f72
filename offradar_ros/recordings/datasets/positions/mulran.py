"""MulRan: global_pose.csv (ground truth), gps.csv (receiver), and tables of UTM positions at radar stamps."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

from offradar_ros.geometry import Trajectory
from offradar_ros.positions.rules import require_accurate
from offradar_ros.recordings.datasets.positions.table import bare_rows, named_rows
from offradar_ros.recordings.datasets.positions.track import Track

UTM_52N = 32652
_POSE = ('stamp', *(f'r{row}{column}' if column < 3 else 'xyz'[row] for row in range(3) for column in range(4)))
_FIX = ('stamp', 'latitude', 'longitude', 'altitude', *(f'covariance {i}' for i in range(9)))


def read_global_pose(path: Path, tally: Counter[str] | None = None, epsg: int = UTM_52N) -> Trajectory:
    """Geodetic positions and yaw of global_pose.csv: 13 columns without header, ns and a row-major 3×4 pose in UTM."""
    track = Track(path, tally)
    for row in bare_rows(path, _POSE):
        with track.row(row):
            pose = [row.finite(at) for at in range(1, 13)]
            track.add_utm(row, track.stamp_ns(row), (pose[3], pose[7], pose[11]), math.atan2(pose[4], pose[0]))
    return track.from_utm(epsg)


def read_mulran_gps(path: Path, tally: Counter[str] | None = None) -> Trajectory:
    """Geodetic positions of gps.csv, yaw unknown: 13 columns without header, ns, position, covariance."""
    track = Track(path, tally)
    for row in bare_rows(path, _FIX):
        with track.row(row):
            require_accurate(row.number_or_nan(4), row.number_or_nan(8))
            position = (row.number_or_nan(1), row.number_or_nan(2), row.number_or_nan(3))
            track.add_geodetic(track.stamp_ns(row), position)
    return track.trajectory()


def read_radar_utm(path: Path, tally: Counter[str] | None = None, epsg: int = UTM_52N) -> Trajectory:
    """Geodetic positions (altitude 0) and yaw of a table timestamp_us, utm_e, utm_n, yaw (from grid east)."""
    track = Track(path, tally)
    for row in named_rows(path, ('timestamp_us', 'utm_e', 'utm_n', 'yaw')):
        with track.row(row):
            position = (row.number_or_nan(1), row.number_or_nan(2), 0.0)
            track.add_utm(row, track.stamp_ns(row), position, row.finite(3))
    return track.from_utm(epsg)
