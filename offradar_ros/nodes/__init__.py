"""The nodes: parameters → array → one core call → message."""

import importlib.util

if importlib.util.find_spec('rclpy') is None:
    raise SystemExit("error: the nodes need ROS 2: source an installation, or pip install '.[ros]' in the project")
