"""Positions recorded in a bag."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, Trajectory
from offradar_ros.messages import point_from_fix, pose_from_odometry, stamp_ns
from offradar_ros.positions.clocks import ArrivalClocks
from offradar_ros.positions.track import PositionTrack
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.topics import FIX_TYPE, ODOMETRY_TYPE
from offradar_ros.types import Pose


class Arrival(NamedTuple):
    """One recorded position message.

    Attributes:
        log_ns: when it was recorded.
        stamp_ns: its header's stamp; −1 where that is none.
        position: what it holds, or why that is no position.
    """

    log_ns: int
    stamp_ns: int
    position: GeoPoint | Pose | RefusedInput


def position_topics(bag: Bag) -> list[str]:
    """Topics with positions, fixes first."""
    return [topic for kind in (FIX_TYPE, ODOMETRY_TYPE) for topic in bag.topics_of(kind)]


def read_positions(bag: Bag, topic: str) -> tuple[Trajectory, Counter[str]]:
    """The usable positions of a topic, and how many were left out by cause."""
    trajectory = trajectory_of(arrivals(bag, topic), geodetic=bag.topics[topic] == FIX_TYPE)
    return trajectory, Counter({left_out.cause: left_out.count for left_out in trajectory.left_out})


def arrivals(bag: Bag, topic: str) -> Iterator[Arrival]:
    """Every message of a topic of positions, in the order in which it was recorded."""
    for raw in bag.messages([topic]):
        message = bag.decode(raw)
        stamp = -1
        position: GeoPoint | Pose | RefusedInput
        try:
            stamp = stamp_ns(message.header.stamp)
            position = point_from_fix(message) if raw.msgtype == FIX_TYPE else pose_from_odometry(message)
        except RefusedInput as refusal:
            position = refusal
        yield Arrival(raw.log_ns, stamp, position)


def trajectory_of(found: Iterable[Arrival], *, geodetic: bool) -> Trajectory:
    """The positions that are used, in the order of their stamps."""
    track = PositionTrack(geodetic=geodetic)
    for _, stamp, position in found:
        try:
            if isinstance(position, RefusedInput):
                raise position
            if isinstance(position, Pose):
                track.add_pose(stamp, position)
            else:
                track.add_point(stamp, dataclasses.astuple(position))
        except RefusedInput as refusal:
            track.leave_out(refusal.cause, str(refusal))
    return track.trajectory()


def arrival_offset_s(scans: Iterable[tuple[int, int]], found: Iterable[Arrival]) -> float | None:
    """What log times say of the clocks, from the scans' log times and stamps in ns; as `ArrivalClocks.offset_s`."""
    clocks = ArrivalClocks()
    waiting = iter(found)
    following = next(waiting, None)
    for log_ns, stamp in scans:
        while following is not None and following.log_ns <= log_ns:
            if following.stamp_ns >= 0:
                clocks.add_position(following.log_ns, following.stamp_ns)
            following = next(waiting, None)
        clocks.add_scan(log_ns, stamp)
    return clocks.offset_s()
