"""Bags with any topics, written message by message, as a vehicle records them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer

from offradar_ros.recordings.bags.reader import TYPES
from offradar_ros.recordings.bags.topics import COMPRESSED_TYPE, FIX, FIX_TYPE, IMAGE_TYPE, SCANS
from offradar_ros.recordings.bags.writer import image_message

GRID_TYPE = 'nav_msgs/msg/OccupancyGrid'
DIAGNOSTICS_TYPE = 'diagnostic_msgs/msg/DiagnosticArray'


class Recorded(NamedTuple):
    """A message to record."""

    log_ns: int
    topic: str
    msgtype: str
    message: Any


def header(stamp_ns: int, frame_id: str = 'radar') -> Any:
    time = TYPES.types['builtin_interfaces/msg/Time'](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return TYPES.types['std_msgs/msg/Header'](stamp=time, frame_id=frame_id)


def scans(drive: Any, topic: str = SCANS) -> Iterator[Recorded]:
    """The scans of a drive as raw images."""
    for index in range(len(drive)):
        scan = drive.scan(index)
        yield Recorded(scan.stamp_ns, topic, IMAGE_TYPE, image_message(scan, plain=True))


def png(power: NDArray[Any]) -> bytes:
    return cv2.imencode('.png', power)[1].tobytes()


def jpeg(power: NDArray[np.uint8]) -> bytes:
    return cv2.imencode('.jpg', power)[1].tobytes()


def compressed_message(stamp_ns: int, data: bytes, form: str = 'mono8; png compressed ') -> Any:
    return TYPES.types[COMPRESSED_TYPE](header=header(stamp_ns), format=form, data=np.frombuffer(data, np.uint8))


def compressed_scans(
    drive: Any, topic: str = f'{SCANS}/compressed', encode: Callable[[NDArray[np.uint8]], bytes] = png
) -> Iterator[Recorded]:
    """The scans of a drive as CompressedImage."""
    for index in range(len(drive)):
        scan = drive.scan(index)
        yield Recorded(scan.stamp_ns, topic, COMPRESSED_TYPE, compressed_message(scan.stamp_ns, encode(scan.power)))


def images(drive: Any, topic: str, encoding: str, height: int, width: int) -> Iterator[Recorded]:
    """Pictures of a camera, one with each scan of a drive."""
    depth = 3 if encoding == 'rgb8' else 1
    for stamp_ns in drive.stamps_ns.tolist():
        image = TYPES.types[IMAGE_TYPE](
            header=header(stamp_ns, 'camera'),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=width * depth,
            data=(np.arange(height * width * depth) % 90).astype(np.uint8),
        )
        yield Recorded(stamp_ns, topic, IMAGE_TYPE, image)


def fixes(drive: Any, topic: str = FIX, east_deg: float = 0.0) -> Iterator[Recorded]:
    """The positions of a drive, moved to the east."""
    for stamp_ns, (latitude, longitude, altitude) in zip(
        drive.trajectory.stamps_ns.tolist(), drive.trajectory.positions.tolist(), strict=True
    ):
        fix = TYPES.types[FIX_TYPE](
            header=header(stamp_ns, 'gps'),
            status=TYPES.types['sensor_msgs/msg/NavSatStatus'](status=0, service=1),
            latitude=latitude,
            longitude=longitude + east_deg,
            altitude=altitude,
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )
        yield Recorded(stamp_ns, topic, FIX_TYPE, fix)


def grid(stamp_ns: int, topic: str) -> Recorded:
    """An occupancy grid, as slam_toolbox and nav2 publish on /map."""
    types = TYPES.types
    origin = types['geometry_msgs/msg/Pose'](
        position=types['geometry_msgs/msg/Point'](x=0.0, y=0.0, z=0.0),
        orientation=types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    time = types['builtin_interfaces/msg/Time'](sec=0, nanosec=0)
    info = types['nav_msgs/msg/MapMetaData'](map_load_time=time, resolution=0.05, width=4, height=4, origin=origin)
    message = types[GRID_TYPE](header=header(stamp_ns, 'map'), info=info, data=np.full(16, -1, np.int8))
    return Recorded(stamp_ns, topic, GRID_TYPE, message)


def report(stamp_ns: int, *names: str, topic: str = '/diagnostics') -> Recorded:
    """Diagnostics with a status of each name."""
    statuses = [
        TYPES.types['diagnostic_msgs/msg/DiagnosticStatus'](level=0, name=name, message='', hardware_id='', values=[])
        for name in names
    ]
    array = TYPES.types[DIAGNOSTICS_TYPE](header=header(stamp_ns, ''), status=statuses)
    return Recorded(stamp_ns, topic, DIAGNOSTICS_TYPE, array)


def latched() -> Qos:
    """Quality of service of a publisher that keeps its last message."""
    never = QosTime(0, 0)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        avoid_ros_namespace_conventions=False,
    )


def record(
    path: Path,
    *streams: Iterable[Recorded],
    plugin: StoragePlugin = StoragePlugin.MCAP,
    empty: Iterable[tuple[str, str]] = (),
    latched_topics: Iterable[str] = (),
) -> Path:
    """Write the messages of all streams in order of time, and topics that are `empty`; returns the folder."""
    rows = sorted((row for stream in streams for row in stream), key=lambda row: row.log_ns)
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, msgtype in [*empty, *((row.topic, row.msgtype) for row in rows)]:
            if (topic, msgtype) not in connections:
                profiles = [latched()] if topic in set(latched_topics) else ()
                connections[topic, msgtype] = writer.add_connection(
                    topic, msgtype, typestore=TYPES, offered_qos_profiles=profiles
                )
        for row in rows:
            known = isinstance(row.message, bytes)
            cdr = row.message if known else TYPES.serialize_cdr(row.message, row.msgtype)
            writer.write(connections[row.topic, row.msgtype], row.log_ns, cdr)
    return path
