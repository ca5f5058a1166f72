"""TUM trajectory files: ``seconds x y z qx qy qz qw`` a line, in the file's own frame."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

from offradar_ros.geometry import Trajectory, yaw_of_quaternion
from offradar_ros.recordings.datasets.positions.table import Row, bare_rows
from offradar_ros.recordings.datasets.positions.track import Track

_NAMES = ('seconds', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')


def read_tum(path: Path, tally: Counter[str] | None = None) -> Trajectory:
    """Positions in metres and yaw about z, both in the file's own frame; seconds may start at zero.

    The yaw is that of the frame whose poses these are. Of a radar that is mounted askew it is the radar's, not the
    vehicle's.
    """
    track = Track(path, tally, geodetic=False)
    for row in bare_rows(path, _NAMES, separator=' '):
        with track.row(row):
            x, y, z, qx, qy, qz, qw = (row.finite(at) for at in range(1, 8))
            yaw_rad = yaw_of_quaternion(qx, qy, qz, qw)
            if math.isnan(yaw_rad):
                raise row.problem('expected a unit quaternion that says a heading, got none')
            track.add_metric(_seconds_to_ns(row), (x, y, z), yaw_rad)
    return track.trajectory()


def _seconds_to_ns(row: Row) -> int:
    """Exact nanoseconds of the seconds as written."""
    seconds = row.finite(0)
    if not 0.0 <= seconds < 9e9:
        raise row.problem(f'expected seconds since the epoch or the start, got {row.cells[0]!r}')
    whole, _, fraction = row.cells[0].partition('.')
    if whole.isdigit() and (fraction.isdigit() or not fraction):
        return int(whole) * 10**9 + int(fraction[:9].ljust(9, '0') or 0)
    return round(seconds * 1e9)
