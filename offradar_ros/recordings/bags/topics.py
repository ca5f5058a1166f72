"""The topics that a converted bag carries, absolute as rosbag2 records them."""

SCANS = '/radar_data/b_scan_image'
FIX = '/gps/fix'
ODOMETRY = '/ground_truth/odometry'
VEHICLE_ODOMETRY = '/odometry'
"""Odometry of the vehicle itself, which converted bags do not have: how far it drives between two scans."""

IMAGE_TYPE = 'sensor_msgs/msg/Image'
FIX_TYPE = 'sensor_msgs/msg/NavSatFix'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'
