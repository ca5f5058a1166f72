"""What is a position, and what is a stamp, whichever way they come in."""

from __future__ import annotations

import math

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint
from offradar_ros.types import Pose

NULL_ISLAND_DEG = 1e-3
"""Within this of 0°, 0°, in the sea off Ghana, a receiver has no fix: zeros, or zeros that a filter has smoothed."""
LOWEST_M, HIGHEST_M = -12_000.0, 20_000.0
"""An altitude beyond these stands for none, like NaN: the position is then that of a 2D fix."""
LARGEST_COORDINATE_M = 2e7
"""Half the way around the Earth: no position in metres, be it UTM, has a larger coordinate."""
LEAST_ACCURATE_M = 100.0
"""Standard deviation of a position that stands for none: places are told apart at a quarter of it."""
YEAR_2000_NS = 946_684_800 * 10**9
END_NS = 2**31 * 10**9
"""Stamps are from 0 to before this, which is in 2038: messages hold seconds in 32 bits."""

FAR_M = 100_000.0
"""Positions farther than this from one another are not of one drive, nor of one map, whose frame is flat."""

CAUSES = {
    'damaged': 'damaged',
    'no_fix': 'without fix',
    'invalid_position': 'not on the Earth',
    'far_position': 'far from all others',
    'position_jump': 'far from those around them',
    'position_held': 'held by the receiver',
    'invalid_stamp': 'with an impossible stamp',
    'repeated_position_stamp': 'repeated stamp',
    'position_stamp_backwards': 'stamp that goes back',
    'position_stamp_jump': 'stamp far from those around it',
}
"""Why a position is left out, by the cause under which it is counted, in words."""


def geo_point(latitude_deg: float, longitude_deg: float, altitude_m: float = math.nan) -> GeoPoint:
    """The position that a receiver reports; an altitude that is not finite, or impossible, becomes 0.

    RefusedInput: `no_fix` for NaN and for 0°, 0° whatever the receiver's status; `invalid_position` for degrees that
    are not on the Earth, such as 999, or a pole.
    """
    latitude_deg, longitude_deg, altitude_m = float(latitude_deg), float(longitude_deg), float(altitude_m)
    where = f'position {latitude_deg}°, {longitude_deg}°'
    if math.isnan(latitude_deg) or math.isnan(longitude_deg):
        raise RefusedInput('no_fix', f'{where}: the receiver has no fix')
    if max(abs(latitude_deg), abs(longitude_deg)) < NULL_ISLAND_DEG:
        raise RefusedInput('no_fix', f'{where}: 0°, 0° stands for no fix, whatever the status says')
    if not (abs(latitude_deg) < 90.0 and abs(longitude_deg) <= 180.0):
        raise RefusedInput(
            'invalid_position', f'{where} is not on the Earth: expected degrees within ±90 and ±180, poles excluded'
        )
    known = LOWEST_M <= altitude_m <= HIGHEST_M
    return GeoPoint(latitude_deg, longitude_deg, altitude_m if known else 0.0)


def require_accurate(*variances_m2: float) -> None:
    """RefusedInput('no_fix') for horizontal variances in m² of a position that is not known to `LEAST_ACCURATE_M`.

    Receivers that search report a last position, or any, and an accuracy of kilometres, with whatever status. NaN, zero
    and negative variances say nothing.
    """
    worst_m = math.sqrt(max((float(v) for v in variances_m2 if v > 0.0), default=0.0))
    if worst_m > LEAST_ACCURATE_M:
        raise RefusedInput(
            'no_fix',
            f'the receiver says that its position is accurate to {worst_m:.0f} m: expected {LEAST_ACCURATE_M:g} m or '
            'less, dropped',
        )


def require_pose(pose: Pose) -> Pose:
    """The same pose in metres; RefusedInput('invalid_position') if it is not finite or larger than the Earth."""
    if not all(abs(v) <= LARGEST_COORDINATE_M for v in (pose.x_m, pose.y_m, pose.z_m)):
        raise RefusedInput(
            'invalid_position',
            f'position {pose.x_m:g}, {pose.y_m:g}, {pose.z_m:g} m: expected finite metres within '
            f'±{LARGEST_COORDINATE_M:g}',
        )
    return pose


def require_stamp(stamp_ns: int) -> int:
    """The same stamp; RefusedInput('invalid_stamp') before 0, where simulated time starts, or from `END_NS` on."""
    if not 0 <= stamp_ns < END_NS:
        raise RefusedInput(
            'invalid_stamp',
            f'stamp {stamp_ns} ns: expected nanoseconds since 1970, or since a simulation started, before 2038',
        )
    return stamp_ns
