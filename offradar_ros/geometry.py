"""Positions of the vehicle: geodetic positions to the local ``map`` frame, and interpolation at a scan's stamp.

Convention: ``map`` is the east-north-up tangent frame at its origin (WGS-84 latitude, longitude in degrees, ellipsoidal
altitude in metres), metres, x east, y north, z up; yaw is counter-clockwise from east.
"""

from __future__ import annotations

import bisect
import collections
import dataclasses
import enum
import functools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.types import Pose

if TYPE_CHECKING:
    import pyproj


MAX_ALTITUDE_M = 1e5
"""Higher than any aircraft: a larger altitude is none."""
_UNIT_TOLERANCE = 0.1
_LEAST_LEVEL = 0.1


@dataclasses.dataclass(frozen=True)
class GeoPoint:
    """WGS-84 latitude and longitude in degrees, ellipsoidal altitude in metres."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0

    def __post_init__(self) -> None:
        within = abs(self.latitude_deg) <= 90.0 and abs(self.longitude_deg) <= 180.0
        if not (within and abs(self.altitude_m) <= MAX_ALTITUDE_M):
            raise RefusedInput(
                'invalid_position',
                f'position latitude {self.latitude_deg}, longitude {self.longitude_deg}, altitude {self.altitude_m} '
                'is not on the Earth: expected degrees within ±90 and ±180, and metres within '
                f'±{MAX_ALTITUDE_M:g}',
            )


class LocalFrame:
    """East-north-up frame tangent to WGS-84 at `origin`."""

    def __init__(self, origin: GeoPoint) -> None:
        # Imported here, because training and evaluation on simulated scans need no PROJ.
        import pyproj  # noqa: PLC0415

        self.origin = origin
        # float(), because PROJ reads the repr of NumPy's scalars as zero.
        latitude, longitude, altitude = map(float, dataclasses.astuple(origin))
        self._pipeline = pyproj.Transformer.from_pipeline(
            '+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad '
            '+step +proj=cart +ellps=WGS84 '
            f'+step +proj=topocentric +ellps=WGS84 +lon_0={longitude!r} +lat_0={latitude!r} '
            f'+h_0={altitude!r}'
        )

    def to_enu(self, points_lla: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) latitude°, longitude°, altitude m → (N, 3) east, north, up in metres."""
        latitude, longitude, altitude = np.asarray(points_lla, np.float64).reshape(-1, 3).T
        return np.stack(self._pipeline.transform(longitude, latitude, altitude), axis=1)

    def to_geodetic(self, points_enu: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) east, north, up in metres → (N, 3) latitude°, longitude°, altitude m."""
        east, north, up = np.asarray(points_enu, np.float64).reshape(-1, 3).T
        longitude, latitude, altitude = self._pipeline.transform(east, north, up, direction='INVERSE')
        return np.stack([latitude, longitude, altitude], axis=1)

    def east_rad(self, points_lla: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) angle of true east at (N, 3) geodetic points, counter-clockwise from the frame's x axis.

        Meridians converge: 50 km east of an origin at 50° north it is half a degree.
        """
        apart_rad = np.radians(points_lla[:, 1] - self.origin.longitude_deg)
        sine = math.sin(math.radians(self.origin.latitude_deg))
        return np.asarray(np.arctan2(sine * np.sin(apart_rad), np.cos(apart_rad)))


@functools.lru_cache(maxsize=16)
def _from_utm(epsg: int) -> pyproj.Transformer:
    import pyproj  # noqa: PLC0415

    return pyproj.Transformer.from_crs(epsg, 4326, always_xy=True)


def utm_to_geodetic(points_enu: NDArray[np.float64], epsg: int) -> NDArray[np.float64]:
    """(N, 3) UTM easting, northing, altitude in metres → (N, 3) latitude°, longitude°, altitude m.

    `epsg` is the UTM zone's code, 326zz north and 327zz south (32630 for Oxford, 32652 for Daejeon).
    """
    easting, northing, altitude = np.asarray(points_enu, np.float64).reshape(-1, 3).T
    longitude, latitude = _from_utm(epsg).transform(easting, northing)
    return np.stack([latitude, longitude, altitude], axis=1)


def geodetic_to_utm(points_lla: NDArray[np.float64], epsg: int) -> NDArray[np.float64]:
    """(N, 3) latitude°, longitude°, altitude m → (N, 3) UTM easting, northing, altitude in metres."""
    latitude, longitude, altitude = np.asarray(points_lla, np.float64).reshape(-1, 3).T
    easting, northing = _from_utm(epsg).transform(longitude, latitude, direction='INVERSE')
    return np.stack([easting, northing, altitude], axis=1)


def wrap_angle(angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles to (−π, π]."""
    return np.asarray(np.pi - np.mod(np.pi - angle_rad, 2 * np.pi))


def yaw_of_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Heading of the x axis of a frame that is turned by this quaternion, radians counter-clockwise from x about z.

    NaN where there is none: a quaternion that is not of unit length, as the zeros that drivers send which know no
    orientation, or an x axis that is all but vertical.
    """
    length = math.hypot(x, y, z, w)
    if not abs(length - 1.0) <= _UNIT_TOLERANCE:
        return math.nan
    along_x, along_y = w * w + x * x - y * y - z * z, 2.0 * (w * z + x * y)
    is_level = math.hypot(along_x, along_y) > _LEAST_LEVEL * length * length
    return math.atan2(along_y, along_x) if is_level else math.nan


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Positions of a recording that are not used.

    Attributes:
        cause: a short, stable name, as that of a `RefusedInput`, or the source's own word for it.
        count: how many.
        first: what is wrong with the first one, and where it is; may be empty.
    """

    cause: str
    count: int
    first: str = ''


@dataclasses.dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions over time, from one sensor of a recording.

    Attributes:
        stamps_ns: (N,) int64, strictly increasing.
        positions: (N, 3) float64: latitude°, longitude°, altitude m if `geodetic`, else metres in a local frame.
        yaws_rad: (N,) float64, heading as the source measured it, counter-clockwise from true east at each position
            (or from the x axis of the local frame); NaN where unknown.
        geodetic: whether `positions` are WGS-84.
        left_out: positions of the source that are not among these, by cause.
        clock_offset_s: seconds to add to `stamps_ns` for the clock of the scans, as far as the recording's log times
            tell; None if they do not.
    """

    stamps_ns: NDArray[np.int64]
    positions: NDArray[np.float64]
    yaws_rad: NDArray[np.float64]
    geodetic: bool
    left_out: tuple[LeftOut, ...] = ()
    clock_offset_s: float | None = None

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def origin(self) -> GeoPoint | None:
        """The first position, as origin of the local frame; None if positions are in a local frame already."""
        if not self.geodetic or not len(self):
            return None
        return GeoPoint(*(float(v) for v in self.positions[0]))

    def in_frame(self, frame: LocalFrame | None) -> Trajectory:
        """The same trajectory in metres of `frame`; one that is in metres already is returned unchanged.

        Headings are then from the frame's x axis, which is east at its origin only.
        """
        if not self.geodetic or frame is None:
            return self
        yaws_rad = wrap_angle(self.yaws_rad + frame.east_rad(self.positions))
        return dataclasses.replace(self, positions=frame.to_enu(self.positions), yaws_rad=yaws_rad, geodetic=False)

    def covers(self, stamps_ns: NDArray[np.int64], max_gap_ns: int) -> NDArray[np.bool_]:
        """(N,) bool: which of (N,) stamps equal that of a position, or lie between two at most `max_gap_ns` apart."""
        if not len(self):
            return np.zeros(len(stamps_ns), np.bool_)
        before, after = self._neighbours(stamps_ns)
        first_ns, last_ns = self.stamps_ns[before], self.stamps_ns[after]
        return np.asarray((first_ns <= stamps_ns) & (stamps_ns <= last_ns) & (last_ns - first_ns <= max_gap_ns))

    def poses_at(self, stamps_ns: NDArray[np.int64], max_gap_ns: int) -> NDArray[np.float64]:
        """(N, 4) float64 position and yaw at (N,) int64 stamps, interpolated linearly between neighbouring positions.

        Positions have the units of `positions`; yaw is interpolated along the shorter arc. NaN outside the trajectory
        and in gaps of more than `max_gap_ns`.
        """
        poses = np.full((len(stamps_ns), 4), np.nan)
        known = self.covers(stamps_ns, max_gap_ns)
        if not known.any():
            return poses
        covered_ns = stamps_ns[known]
        before, after = self._neighbours(covered_ns)
        # Where both neighbours are the same position, step and fraction are 0.
        step_ns = np.maximum(self.stamps_ns[after] - self.stamps_ns[before], 1)
        fraction = (covered_ns - self.stamps_ns[before]) / step_ns
        start, end = self.positions[before], self.positions[after]
        turn = wrap_angle(self.yaws_rad[after] - self.yaws_rad[before])
        poses[known, :3] = start + fraction[:, None] * (end - start)
        poses[known, 3] = wrap_angle(self.yaws_rad[before] + fraction * turn)
        return poses

    def _neighbours(self, stamps_ns: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(N,) rows of the last position not after each stamp, and of the first not before it, clipped to the ends."""
        after = np.searchsorted(self.stamps_ns, stamps_ns)
        before = np.searchsorted(self.stamps_ns, stamps_ns, side='right') - 1
        last = len(self) - 1
        return np.asarray(np.clip(before, 0, last)), np.asarray(np.clip(after, 0, last))


class NoPosition(enum.Enum):
    """Why there is no position at a stamp: it may still arrive, or it cannot."""

    NOT_YET = 'not_yet'
    NEVER = 'never'


class PositionBuffer:
    """Recent positions in time order, and interpolation between them at a stamp.

    There is no interpolation between neighbours more than `max_gap_ns` apart, and no extrapolation.
    """

    def __init__(self, max_gap_ns: int, capacity: int = 4096) -> None:
        self.max_gap_ns = max_gap_ns
        self._stamps: collections.deque[int] = collections.deque(maxlen=capacity)
        self._poses: collections.deque[Pose] = collections.deque(maxlen=capacity)

    def add(self, stamp_ns: int, pose: Pose) -> None:
        """Add a position; RefusedInput if it is not finite or not newer than the last."""
        require_next(stamp_ns, pose, self.last_stamp_ns)
        self._stamps.append(stamp_ns)
        self._poses.append(pose)

    def clear(self) -> None:
        """Remove all positions, as when a recording starts again."""
        self._stamps.clear()
        self._poses.clear()

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the newest position; None without one."""
        return self._stamps[-1] if self._stamps else None

    def at(self, stamp_ns: int) -> Pose | NoPosition:
        """Pose at `stamp_ns`; NOT_YET while a later position may still follow it."""
        after = bisect.bisect_left(self._stamps, stamp_ns)
        if after < len(self._stamps) and self._stamps[after] == stamp_ns:
            return self._poses[after]
        if after == len(self._stamps):
            return NoPosition.NOT_YET
        if after == 0 or self._stamps[after] - self._stamps[after - 1] > self.max_gap_ns:
            return NoPosition.NEVER
        before_ns, after_ns = self._stamps[after - 1], self._stamps[after]
        return interpolate(self._poses[after - 1], self._poses[after], (stamp_ns - before_ns) / (after_ns - before_ns))


def require_next(stamp_ns: int, pose: Pose, last_ns: int | None) -> None:
    """RefusedInput unless a position is finite, and newer than the one of stamp `last_ns`; None for the first."""
    if not all(math.isfinite(v) for v in (pose.x_m, pose.y_m, pose.z_m)):
        raise RefusedInput('invalid_position', f'position at {stamp_ns} ns is not finite: {pose}')
    if last_ns is not None and stamp_ns <= last_ns:
        cause = 'repeated_position_stamp' if stamp_ns == last_ns else 'position_stamp_backwards'
        raise RefusedInput(cause, f'position stamp {stamp_ns} ns is not after the last one, {last_ns} ns: dropped')


def interpolate(start: Pose, end: Pose, fraction: float) -> Pose:
    """Pose at `fraction` of the straight line from `start` to `end`; yaw follows the shorter arc.

    Errors of neighbouring headings are much the same, so that the standard deviation is that of the nearer one.
    """
    turn = float(wrap_angle(np.asarray(end.yaw_rad - start.yaw_rad)))
    return Pose(
        start.x_m + fraction * (end.x_m - start.x_m),
        start.y_m + fraction * (end.y_m - start.y_m),
        start.z_m + fraction * (end.z_m - start.z_m),
        float(wrap_angle(np.asarray(start.yaw_rad + fraction * turn))),
        (start if fraction < 0.5 else end).yaw_sd_rad,
    )
