"""Boreas: applanix/radar_poses.csv, post-processed poses at radar stamps."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.positions.table import named_rows
from offradar_ros.recordings.datasets.positions.track import Track

UTM_17N = 32617


def read_radar_poses(path: Path, tally: Counter[str] | None = None, epsg: int = UTM_17N) -> Trajectory:
    """Geodetic positions and yaw; stamps in ns or µs, `epsg` is the UTM zone (17N holds Toronto).

    The file's heading is counter-clockwise from grid east: in the published files it is the direction of the velocity
    columns to within a degree while driving.
    """
    track = Track(path, tally)
    for row in named_rows(path, ('GPSTime', 'easting', 'northing', 'altitude', 'heading')):
        with track.row(row):
            position = (row.number_or_nan(1), row.number_or_nan(2), row.number_or_nan(3))
            track.add_utm(row, track.stamp_ns(row), position, row.finite(4))
    return track.from_utm(epsg)
