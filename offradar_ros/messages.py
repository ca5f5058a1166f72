"""Messages to records, for messages deserialised by rclpy (on the vehicle) or by rosbags (offline).

Only attributes are read, so that both give the same record for the same bytes.
"""

from __future__ import annotations

import math
import struct
from typing import Any, Protocol

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import GeoPoint, yaw_of_quaternion
from offradar_ros.positions.rules import geo_point, require_accurate, require_pose
from offradar_ros.radar.image import decode_polar_image
from offradar_ros.radar.png import decode_png
from offradar_ros.types import PolarScan, Pose

NO_FIX = -1
UNKNOWN_COVARIANCE = 0
_JPEG = b'\xff\xd8\xff'
# CDR: 4 bytes of encapsulation, then the header's stamp, in every message that starts with std_msgs/Header.
_STAMP_OFFSET = 4
SHORTEST = _STAMP_OFFSET + 8
"""Bytes of the shortest message that has a stamp."""


class StampMessage(Protocol):
    """builtin_interfaces/Time."""

    sec: int
    nanosec: int


def stamp_ns(stamp: StampMessage) -> int:
    """Nanoseconds since the Unix epoch; RefusedInput('invalid_stamp') for a stamp before it, or of 10⁹ ns or more."""
    seconds, nanoseconds = int(stamp.sec), int(stamp.nanosec)
    if seconds < 0 or not 0 <= nanoseconds < 10**9:
        raise RefusedInput(
            'invalid_stamp',
            f'header stamp of {seconds} s and {nanoseconds} ns: expected 0 s or more, and less than 1000000000 ns',
        )
    return seconds * 10**9 + nanoseconds


def scan_from_image(message: Any, config: RadarConfig) -> PolarScan:
    """The scan in a sensor_msgs/Image; RefusedInput says what is wrong with it."""
    return decode_polar_image(
        message.data,
        height=message.height,
        width=message.width,
        step=message.step,
        encoding=message.encoding,
        stamp_ns=stamp_ns(message.header.stamp),
        config=config,
    )


def scan_from_compressed(message: Any, config: RadarConfig) -> PolarScan:
    """The scan in a sensor_msgs/CompressedImage that holds a PNG; RefusedInput says what is wrong with it.

    What it holds is told by its data: publishers fill `format` in many ways. JPEG is refused, because it is lossy.
    """
    data = bytes(message.data)
    if data.startswith(_JPEG):
        raise RefusedInput(
            'lossy_image',
            'compressed polar image is a JPEG, which changes the power and destroys the metadata columns: '
            "expected a PNG (image_transport's parameter format: png)",
        )
    try:
        return decode_png(data, stamp_ns(message.header.stamp), config)
    except DataError as error:
        raise RefusedInput(
            'wrong_encoding', f'compressed polar image of format {message.format[:80]!r}: {error}'
        ) from None


def point_from_fix(message: Any) -> GeoPoint:
    """The position in a sensor_msgs/NavSatFix; RefusedInput (`no_fix`, `invalid_position`) where it holds none."""
    if message.status.status == NO_FIX:
        raise RefusedInput('no_fix', 'NavSatFix status is -1 (no fix): position dropped')
    if message.position_covariance_type != UNKNOWN_COVARIANCE:
        require_accurate(message.position_covariance[0], message.position_covariance[4])
    return geo_point(message.latitude, message.longitude, message.altitude)


def pose_from_odometry(message: Any) -> Pose:
    """The pose in a nav_msgs/Odometry; RefusedInput('invalid_position') if its position is none.

    The yaw is about z, and NaN where the orientation is none (`yaw_of_quaternion`). Its standard deviation is that of
    the covariance, at most π, and NaN where that is not given, as zero or negative.
    """
    position, q, variance = message.pose.pose.position, message.pose.pose.orientation, message.pose.covariance[35]
    sd_rad = min(math.sqrt(variance), math.pi) if variance > 0.0 else math.nan
    return require_pose(Pose(position.x, position.y, position.z, yaw_of_quaternion(q.x, q.y, q.z, q.w), sd_rad))


def header_stamp_ns(cdr: bytes) -> int:
    """Header stamp (nanoseconds) of a serialised message of at least `SHORTEST` bytes; the rest is not decoded."""
    seconds, nanoseconds = struct.unpack_from(_stamp_format(cdr), cdr, _STAMP_OFFSET)
    return int(seconds) * 10**9 + int(nanoseconds)


def with_header_stamp(cdr: bytes, stamp_ns: int) -> bytes:
    """The same serialised message with another header stamp."""
    changed = bytearray(cdr)
    struct.pack_into(_stamp_format(cdr), changed, _STAMP_OFFSET, *divmod(stamp_ns, 10**9))
    return bytes(changed)


def _stamp_format(cdr: bytes) -> str:
    # The second byte says in which order the bytes of numbers are.
    return '<iI' if cdr[1] else '>iI'
