"""The topics that a converted bag carries, absolute as rosbag2 records them, and those that are to be read of a bag."""

from __future__ import annotations

from typing import NamedTuple

SCANS = '/radar_data/b_scan_image'
FIX = '/gps/fix'
ODOMETRY = '/ground_truth/odometry'
VEHICLE_ODOMETRY = '/odometry'
"""Odometry of the vehicle itself, which converted bags do not have: how far it drives between two scans."""

COMPRESSED = '/compressed'
"""What image_transport adds to the name of a topic of images for that of the same images compressed."""

IMAGE_TYPE = 'sensor_msgs/msg/Image'
COMPRESSED_TYPE = 'sensor_msgs/msg/CompressedImage'
FIX_TYPE = 'sensor_msgs/msg/NavSatFix'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'


class ChosenTopics(NamedTuple):
    """Topics that a person chose, with or without the leading slash; where one is empty, the bag decides.

    Attributes:
        scans: polar images, as Image or CompressedImage.
        positions: NavSatFix or Odometry.
    """

    scans: str = ''
    positions: str = ''


def absolute(topic: str) -> str:
    """The name of a topic as rosbag2 records it."""
    return '/' + topic.lstrip('/')
