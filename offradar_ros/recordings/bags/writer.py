"""Any RadarSequence to a rosbag2 folder with MCAP storage (zstd chunks, checksums of every byte).

A bag is written within ``OUT.TOKEN.partial`` and moved out when it is complete, so that an interrupted run never leaves
a bag that looks complete: a rosbag2 folder without ``metadata.yaml`` opens nowhere. A bag that it replaces is moved
aside, to ``OUT.replaced``, and removed only when the new one is in its place.
"""

from __future__ import annotations

import dataclasses
import heapq
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from offradar_ros.config import PositionConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import LocalFrame, Trajectory
from offradar_ros.positions.headings import headings_of
from offradar_ros.positions.rules import END_NS, require_stamp
from offradar_ros.radar.navtech_rows import join_rows
from offradar_ros.recordings.bags.mcap_checksums import write_checksums
from offradar_ros.recordings.bags.reader import TYPES
from offradar_ros.recordings.bags.topics import FIX, FIX_TYPE, IMAGE_TYPE, ODOMETRY, ODOMETRY_TYPE, SCANS
from offradar_ros.recordings.datasets.coverage import span_ns
from offradar_ros.recordings.new_folder import new_folder
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

POSITION_MARGIN_NS = 5 * 10**9
Progress = Callable[[int, int], None]
Unreadable = Callable[[int, DataError | RefusedInput], None]
_Stamped = tuple[int, int, str, Any]


@dataclasses.dataclass(frozen=True)
class BagOptions:
    """What goes into a bag.

    Attributes:
        plain: leave out the 11 metadata columns, as Navtech's driver does; by default they are kept where the source
            has them, and with them each row's azimuth and stamp.
        position_offset_ns: added to every position's stamp, for data sets whose clocks disagree.
        overwrite: replace an existing bag.
        encoder_size: counts in a rotation, for the metadata columns.
    """

    plain: bool = False
    position_offset_ns: int = 0
    overwrite: bool = False
    encoder_size: int = 5600


def write_bag(
    sequence: RadarSequence,
    out: str | Path,
    options: BagOptions | None = None,
    progress: Progress | None = None,
    unreadable: Unreadable | None = None,
) -> Path:
    """Write scans, ``gps/fix`` and ``ground_truth/odometry`` in order of time; returns the folder.

    Positions are those of the drive and of the few seconds around it, so that its ends can be interpolated. A scan that
    cannot be read, or has a stamp that no ROS message holds, is an error, unless `unreadable(index, error)` is given
    and returns: then the scan is left out. Raises DataError if the sequence is empty, no scan can be read, or `out`
    exists, is not a bag that may be replaced, or cannot be written.
    """
    options = options or BagOptions()
    out = Path(out)
    if not len(sequence):
        raise DataError(f'{sequence.name}: holds no scans: nothing to convert')
    with new_folder(out, overwrite=options.overwrite) as draft:
        _write(sequence, draft, options, progress or (lambda _done, _total: None), unreadable or _stop)
    return out


def _stop(_index: int, error: DataError | RefusedInput) -> None:
    raise error


def _write(
    sequence: RadarSequence, path: Path, options: BagOptions, progress: Progress, unreadable: Unreadable
) -> None:
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    trajectory = _covering(sequence, options.position_offset_ns)
    with writer:
        connections = {SCANS: writer.add_connection(SCANS, IMAGE_TYPE, typestore=TYPES)}
        streams: list[Iterator[_Stamped]] = [_scans(sequence, options, progress, unreadable)]
        if trajectory is not None:
            if trajectory.geodetic:
                connections[FIX] = writer.add_connection(FIX, FIX_TYPE, typestore=TYPES)
                streams.append(_fixes(trajectory))
            connections[ODOMETRY] = writer.add_connection(ODOMETRY, ODOMETRY_TYPE, typestore=TYPES)
            streams.append(_odometry(trajectory))
        for stamp_ns, _rank, topic, message in heapq.merge(*streams, key=lambda item: item[:2]):
            connection = connections[topic]
            writer.write(connection, stamp_ns, TYPES.serialize_cdr(message, connection.msgtype))
    write_checksums(path / f'{path.name}.mcap')


def _covering(sequence: RadarSequence, offset_ns: int) -> Trajectory | None:
    trajectory = sequence.trajectory
    if trajectory is None:
        return None
    stamps_ns = trajectory.stamps_ns + offset_ns
    first_ns, last_ns = span_ns(sequence.stamps_ns)
    start_ns, end_ns = max(first_ns - POSITION_MARGIN_NS, 0), min(last_ns + POSITION_MARGIN_NS, END_NS - 1)
    keep = (stamps_ns >= start_ns) & (stamps_ns <= end_ns)
    if not keep.any():
        return None
    return dataclasses.replace(
        trajectory,
        stamps_ns=stamps_ns[keep],
        positions=trajectory.positions[keep],
        yaws_rad=trajectory.yaws_rad[keep],
    )


def _header(stamp_ns: int, frame_id: str) -> Any:
    time = TYPES.types['builtin_interfaces/msg/Time'](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return TYPES.types['std_msgs/msg/Header'](stamp=time, frame_id=frame_id)


def image_message(scan: PolarScan, *, plain: bool, encoder_size: int = 5600) -> Any:
    """The scan as Navtech's driver sends it (8UC1, rows = azimuths), with metadata columns unless `plain`."""
    rows = scan.power if plain or scan.azimuth_stamps_ns is None else join_rows(scan, encoder_size)
    height, width = rows.shape
    return TYPES.types[IMAGE_TYPE](
        header=_header(scan.stamp_ns, 'radar'),
        height=height,
        width=width,
        encoding='8UC1',
        is_bigendian=0,
        step=width,
        data=np.ascontiguousarray(rows).reshape(-1),
    )


def _scans(
    sequence: RadarSequence, options: BagOptions, progress: Progress, unreadable: Unreadable
) -> Iterator[_Stamped]:
    errors: list[DataError | RefusedInput] = []
    for index in range(len(sequence)):
        try:
            scan = sequence.scan(index)
            require_stamp(scan.stamp_ns)
        except (DataError, RefusedInput) as error:
            unreadable(index, error)
            errors.append(error)
        else:
            message = image_message(scan, plain=options.plain, encoder_size=options.encoder_size)
            yield scan.stamp_ns, 1, SCANS, message
        progress(index + 1, len(sequence))
    if len(errors) == len(sequence):
        raise DataError(f'{sequence.name}: none of its {len(sequence)} scans can be read: {errors[0]}')


def _fixes(trajectory: Trajectory) -> Iterator[_Stamped]:
    status = TYPES.types['sensor_msgs/msg/NavSatStatus'](status=0, service=1)
    for stamp, (latitude, longitude, altitude) in zip(trajectory.stamps_ns, trajectory.positions, strict=True):
        message = TYPES.types[FIX_TYPE](
            header=_header(int(stamp), 'gps'),
            status=status,
            latitude=float(latitude),
            longitude=float(longitude),
            altitude=float(altitude),
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )
        yield int(stamp), 0, FIX, message


def _odometry(trajectory: Trajectory) -> Iterator[_Stamped]:
    types = TYPES.types
    origin = trajectory.origin()
    metric = trajectory.in_frame(LocalFrame(origin) if origin else None)
    vector = types['geometry_msgs/msg/Vector3'](x=0.0, y=0.0, z=0.0)
    twist = types['geometry_msgs/msg/TwistWithCovariance'](
        twist=types['geometry_msgs/msg/Twist'](linear=vector, angular=vector), covariance=np.zeros(36)
    )
    for stamp, (x, y, z), (yaw, variance) in zip(metric.stamps_ns, metric.positions, _headings(metric), strict=True):
        covariance = np.zeros(36)
        covariance[35] = variance
        orientation = types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
        pose = types['geometry_msgs/msg/Pose'](
            position=types['geometry_msgs/msg/Point'](x=float(x), y=float(y), z=float(z)), orientation=orientation
        )
        message = types[ODOMETRY_TYPE](
            header=_header(int(stamp), 'map'),
            child_frame_id='base_link',
            pose=types['geometry_msgs/msg/PoseWithCovariance'](pose=pose, covariance=covariance),
            twist=twist,
        )
        yield int(stamp), 0, ODOMETRY, message


def _headings(trajectory: Trajectory) -> list[tuple[float, float]]:
    """Those that are measured, or else of the way that is driven. An odometry message is always a valid pose.

    Where neither is known, as where the vehicle never moves, it is the last one before, or 0. Each has a variance: that
    of the course; π² for one that is not known; 0, by which messages say nothing, for one that is measured.
    """
    position = PositionConfig()
    found = headings_of(trajectory, position.heading, round(position.max_gap_s * 1e9)).tolist()
    last_rad, headings = 0.0, []
    for (yaw_rad, sd_rad), measured_rad in zip(found, trajectory.yaws_rad.tolist(), strict=True):
        last_rad, variance = (last_rad, math.pi**2) if math.isnan(yaw_rad) else (yaw_rad, min(sd_rad, math.pi) ** 2)
        headings.append((last_rad, 0.0 if yaw_rad == measured_rad else variance))
    return headings
