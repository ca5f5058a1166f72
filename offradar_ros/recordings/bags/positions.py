"""Positions recorded in a bag."""

from __future__ import annotations

import dataclasses
from collections import Counter

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import Trajectory
from offradar_ros.messages import point_from_fix, pose_from_odometry, stamp_ns
from offradar_ros.positions.track import PositionTrack
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.topics import FIX_TYPE, ODOMETRY_TYPE


def position_topics(bag: Bag) -> list[str]:
    """Topics with positions, fixes first."""
    return [topic for kind in (FIX_TYPE, ODOMETRY_TYPE) for topic in bag.topics_of(kind)]


def read_positions(bag: Bag, topic: str) -> tuple[Trajectory, Counter[str]]:
    """The usable positions of a topic, and how many were left out by cause."""
    track = PositionTrack(geodetic=bag.topics[topic] == FIX_TYPE)
    for raw in bag.messages([topic]):
        message = bag.decode(raw)
        try:
            if raw.msgtype == FIX_TYPE:
                point = point_from_fix(message)
                track.add_point(stamp_ns(message.header.stamp), dataclasses.astuple(point))
            else:
                track.add_pose(stamp_ns(message.header.stamp), pose_from_odometry(message))
        except RefusedInput as refusal:
            track.leave_out(refusal.cause, str(refusal))
    return track.trajectory(), track.tally
