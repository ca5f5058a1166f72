"""The nodes: parameters → array → one core call → message."""

import importlib.util
import os

from offradar_ros.ros.shared_memory import shared_memory_problem

# Read by NumPy when it is imported. A search of a map in several threads waits for all of them: on a busy machine many
# times longer than it computes.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# Read by OpenCV when it is first used. The images are so small that its threads wait for one another, in busy loops,
# for longer than they compute.
os.environ.setdefault('OPENCV_FOR_THREADS_NUM', '1')

if importlib.util.find_spec('rclpy') is None:
    raise SystemExit("error: the nodes need ROS 2: source an installation, or pip install '.[ros]' in the project")
if problem := shared_memory_problem():
    raise SystemExit(f'error: {problem}')
