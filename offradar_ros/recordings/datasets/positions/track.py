"""Collects the positions of a table into a Trajectory: one bad row of thousands costs no drive."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import Trajectory, utm_to_geodetic, wrap_angle
from offradar_ros.positions.rules import CAUSES
from offradar_ros.positions.track import PositionTrack
from offradar_ros.recordings.datasets.positions.table import Row, has_missing_digits
from offradar_ros.types import Pose

MOST_BAD = 0.25
"""A table is refused where a larger share of its rows is damaged or contradicts the others."""
_BAD = ('damaged', 'invalid_position', 'invalid_stamp', 'position_stamp_backwards')
_ROUNDED_NS = 10_000_000
_FEWEST_ROUNDED = 3


class Track:
    """Collects the rows of one table. Rows that are left out are counted in `tally` by cause."""

    def __init__(self, path: Path, tally: Counter[str] | None, *, geodetic: bool = True) -> None:
        self._path = path
        self._track = PositionTrack(geodetic=geodetic, tally=tally)
        self._rows = 0
        self._bad = 0
        self._first_bad = ''
        self._stamps: Counter[int] = Counter()
        self._digits_missing = False
        self._utm: list[tuple[Row, int, tuple[float, float, float], float]] = []

    @contextlib.contextmanager
    def row(self, row: Row) -> Iterator[None]:
        """Read one row; a DataError or RefusedInput in it leaves that row out."""
        self._rows += 1
        with self._leaving_out(row):
            yield

    @contextlib.contextmanager
    def _leaving_out(self, row: Row) -> Iterator[None]:
        try:
            yield
        except DataError as error:
            self._leave_out('damaged', str(error))
        except RefusedInput as refusal:
            self._leave_out(refusal.cause, str(row.problem(str(refusal))))

    def _leave_out(self, cause: str, problem: str) -> None:
        self._track.leave_out(cause, problem.removeprefix(f'{self._path}, '))
        if cause in _BAD:
            self._bad += 1
            self._first_bad = self._first_bad or problem

    def leave_out(self, reason: str) -> None:
        """Count a row that says itself that it holds no position."""
        self._track.leave_out(reason)

    def leave_out_damaged(self, error: DataError) -> None:
        """Count a line that names no row."""
        self._rows += 1
        self._leave_out('damaged', str(error))

    def stamp_ns(self, row: Row, at: int = 0) -> int:
        """The row's stamp. It is remembered: a table whose stamps are rounded is refused at the end."""
        stamp_ns = row.stamp_ns(at)
        self._stamps[stamp_ns] += 1
        self._digits_missing = self._digits_missing or has_missing_digits(row.text(at))
        return stamp_ns

    def add_geodetic(self, stamp_ns: int, position: tuple[float, float, float], yaw_rad: float = math.nan) -> None:
        """Append latitude°, longitude°, altitude m."""
        self._track.add_point(stamp_ns, position, yaw_rad)

    def add_metric(self, stamp_ns: int, position: tuple[float, float, float], yaw_rad: float = math.nan) -> None:
        """Append x, y, z in metres."""
        self._track.add_pose(stamp_ns, Pose(*position, yaw_rad))

    def add_utm(self, row: Row, stamp_ns: int, position: tuple[float, float, float], yaw_rad: float = math.nan) -> None:
        """Append UTM easting, northing, altitude in metres, and yaw from grid east, for `from_utm`."""
        if math.isnan(position[0]) or math.isnan(position[1]) or position[:2] == (0.0, 0.0):
            raise RefusedInput('no_fix', 'easting and northing stand for no fix')
        self._utm.append((row, stamp_ns, position, yaw_rad))

    def trajectory(self) -> Trajectory:
        """The positions, as latitude, longitude, altitude or in metres of the file's frame.

        DataError where there is none, where more than `MOST_BAD` of the rows are bad, or where stamps are rounded.
        """
        self._refuse_rounded()
        found = self._track.trajectory()
        if self._bad > MOST_BAD * self._rows:
            others = f' ({self._bad} of {self._rows} rows are bad)' if self._bad > 1 else ''
            raise DataError(f'{self._first_bad}{others}')
        if not len(found):
            tally = sorted(self._track.tally.items())
            left_out = ', '.join(f'{count} {CAUSES.get(cause, cause)}' for cause, count in tally)
            raise DataError(f'{self._path}: holds no position' + (f' ({left_out})' if left_out else ''))
        return dataclasses.replace(found, yaws_rad=wrap_angle(found.yaws_rad))

    def from_utm(self, epsg: int) -> Trajectory:
        """The positions as UTM easting, northing, altitude, converted to geodetic; yaw from grid east to true east."""
        import pyproj  # noqa: PLC0415

        points = utm_to_geodetic(np.array([position for _, _, position, _ in self._utm]).reshape(-1, 3), epsg)
        for (row, stamp_ns, _, yaw_rad), (latitude, longitude, altitude) in zip(self._utm, points, strict=True):
            with self._leaving_out(row):
                if not math.isfinite(latitude + longitude):
                    raise RefusedInput('invalid_position', f'expected UTM easting and northing in metres (EPSG {epsg})')
                self.add_geodetic(stamp_ns, (latitude, longitude, altitude), yaw_rad)
        self._utm.clear()
        found = self.trajectory()
        # Grid north is clockwise of true north by the meridian convergence: about a degree at a zone's edge.
        factors = pyproj.Proj(epsg).get_factors(found.positions[:, 1], found.positions[:, 0])
        yaws_rad = wrap_angle(found.yaws_rad - np.radians(factors.meridian_convergence))
        return dataclasses.replace(found, yaws_rad=yaws_rad)

    def _refuse_rounded(self) -> None:
        """DataError where stamps repeat because digits are missing, as a spreadsheet or a %g leaves them."""
        total, distinct = self._stamps.total(), len(self._stamps)
        if total < _FEWEST_ROUNDED or (
            total < _FEWEST_ROUNDED * distinct and not (self._digits_missing and 4 * (total - distinct) >= total)
        ):
            return
        step_ns = math.gcd(*self._stamps)
        unit_ns = 10 ** (len(str(step_ns)) - len(str(step_ns).rstrip('0')))
        if unit_ns >= _ROUNDED_NS:
            raise DataError(
                f'{self._path}: stamps are rounded to {unit_ns / 1e9:g} s: {distinct} different ones in {total} rows; '
                'expected every digit, which a spreadsheet or %g does not write'
            )
