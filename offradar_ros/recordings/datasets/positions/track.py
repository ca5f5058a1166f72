"""Collects the positions of a file into a Trajectory."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.geometry import Trajectory, utm_to_geodetic, wrap_angle
from offradar_ros.recordings.datasets.positions.table import Row

DUPLICATE = 'repeated stamp'
BACKWARDS = 'stamp that goes back'
NO_FIX = 'without fix'


class Track:
    """Collects positions in time order; `tally` counts the rows that were left out, by reason.

    A stamp that goes back is an error, unless `allow_backwards` leaves its row out.
    """

    def __init__(self, path: Path, tally: Counter[str] | None, *, allow_backwards: bool = False) -> None:
        self._path = path
        self._allow_backwards = allow_backwards
        self._tally: Counter[str] = Counter() if tally is None else tally
        self._stamps: list[int] = []
        self._rows: list[tuple[float, float, float, float]] = []

    def leave_out(self, reason: str) -> None:
        """Count a row that gives no position."""
        self._tally[reason] += 1

    def add(self, row: Row, stamp_ns: int, position: tuple[float, float, float], yaw_rad: float = math.nan) -> None:
        """Append a finite position; a repeated stamp is left out."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            if stamp_ns == self._stamps[-1]:
                self.leave_out(DUPLICATE)
                return
            if self._allow_backwards:
                self.leave_out(BACKWARDS)
                return
            back_s = (self._stamps[-1] - stamp_ns) / 1e9
            raise row.problem(f'stamp goes back by {back_s:.6g} s: expected stamps that grow')
        self._stamps.append(stamp_ns)
        self._rows.append((*position, yaw_rad))

    def add_geodetic(self, row: Row, stamp_ns: int, position: tuple[float, float, float]) -> None:
        """Append latitude°, longitude°, altitude m; receivers without a fix write NaN or 0, 0: left out."""
        latitude, longitude, altitude = position
        if not all(math.isfinite(v) for v in position) or (latitude == 0.0 and longitude == 0.0):
            self.leave_out(NO_FIX)
            return
        if abs(latitude) > 90.0 or abs(longitude) > 180.0:
            raise row.problem(f'expected latitude and longitude in degrees, got {latitude:g}, {longitude:g}')
        self.add(row, stamp_ns, (latitude, longitude, altitude))

    def _columns(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        if not self._rows:
            left_out = ', '.join(f'{count} {reason}' for reason, count in sorted(self._tally.items()))
            raise DataError(f'{self._path}: holds no position' + (f' ({left_out})' if left_out else ''))
        table = np.array(self._rows, np.float64)
        return np.array(self._stamps, np.int64), table[:, :3], wrap_angle(table[:, 3])

    def geodetic(self) -> Trajectory:
        """The positions as latitude, longitude, altitude."""
        return Trajectory(*self._columns(), geodetic=True)

    def local(self) -> Trajectory:
        """The positions as metres in the file's frame."""
        return Trajectory(*self._columns(), geodetic=False)

    def from_utm(self, epsg: int) -> Trajectory:
        """The positions as UTM easting, northing, altitude, converted to geodetic; yaw from grid east to true east."""
        import pyproj  # noqa: PLC0415

        stamps, utm, yaws = self._columns()
        points = utm_to_geodetic(utm, epsg)
        if not np.isfinite(points).all():
            raise DataError(f'{self._path}: expected UTM easting and northing in metres (EPSG {epsg})')
        # Grid north is clockwise of true north by the meridian convergence: about a degree at a zone's edge.
        convergence_deg = pyproj.Proj(epsg).get_factors(points[:, 1], points[:, 0]).meridian_convergence
        return Trajectory(stamps, points, wrap_angle(yaws - np.radians(convergence_deg)), geodetic=True)
