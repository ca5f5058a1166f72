"""Positions recorded in a bag."""

from __future__ import annotations

from collections import Counter

import numpy as np

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import Trajectory
from offradar_ros.messages import point_from_fix, pose_from_odometry, stamp_ns
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.topics import FIX_TYPE, ODOMETRY_TYPE


def position_topics(bag: Bag) -> list[str]:
    """Topics with positions, fixes first."""
    return [topic for kind in (FIX_TYPE, ODOMETRY_TYPE) for topic in bag.topics_of(kind)]


def read_positions(bag: Bag, topic: str) -> tuple[Trajectory, Counter[str]]:
    """The usable positions of a topic, and how many were refused by cause."""
    rows: list[tuple[int, float, float, float, float]] = []
    refused: Counter[str] = Counter()
    geodetic = bag.topics[topic] == FIX_TYPE
    for raw in bag.messages([topic]):
        message = bag.decode(raw)
        stamp = stamp_ns(message.header.stamp)
        try:
            if rows and stamp <= rows[-1][0]:
                raise RefusedInput('repeated_position_stamp', f'{topic}: stamp {stamp} ns is not after the last one')
            if geodetic:
                point = point_from_fix(message)
                rows.append((stamp, point.latitude_deg, point.longitude_deg, point.altitude_m, np.nan))
            else:
                pose = pose_from_odometry(message)
                rows.append((stamp, pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad))
        except RefusedInput as refusal:
            refused[refusal.cause] += 1
    trajectory = Trajectory(
        stamps_ns=np.array([row[0] for row in rows], np.int64),
        positions=np.array([row[1:4] for row in rows], np.float64).reshape(-1, 3),
        yaws_rad=np.array([row[4] for row in rows], np.float64),
        geodetic=geodetic,
    )
    return trajectory, refused
