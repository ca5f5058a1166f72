"""Readers of the data sets' position files; each returns a geometry.Trajectory."""

from offradar_ros.recordings.datasets.positions.boreas import read_radar_poses
from offradar_ros.recordings.datasets.positions.mulran import read_global_pose, read_mulran_gps, read_radar_utm
from offradar_ros.recordings.datasets.positions.oxford import read_oxford_gps, read_oxford_ins
from offradar_ros.recordings.datasets.positions.radiate import read_gps_twist
from offradar_ros.recordings.datasets.positions.tum import read_tum

__all__ = [
    'read_global_pose',
    'read_gps_twist',
    'read_mulran_gps',
    'read_oxford_gps',
    'read_oxford_ins',
    'read_radar_poses',
    'read_radar_utm',
    'read_tum',
]
