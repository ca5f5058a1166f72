"""Start and stop of a node process: exit status 0 on SIGINT, double SIGINT and SIGTERM, 1 with one line on an error."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.utilities import remove_ros_args

from offradar_ros.errors import OffradarError
from offradar_ros.ros.stage_node import StageNode

USAGE = (
    'Usage: NODE --ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO]. '
    '`offradar parameters` lists the parameters.'
)


def run(make_node: Callable[[], StageNode], args: list[str] | None = None) -> int:
    """Spin the node until the context is shut down; the exit status."""
    stray = _stray(sys.argv if args is None else ['', *args])
    if stray:
        if stray[0] in ('-h', '--help'):
            print(USAGE)
            return 0
        print(f'error: argument {stray[0]!r} is unknown. {USAGE}', file=sys.stderr)
        return 2
    # rclpy's own handler still shuts the context down. Without this, a second SIGINT (ros2 launch sends two) raises
    # KeyboardInterrupt in the middle of the clean-up.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    node: StageNode | None = None
    status = 0
    try:
        _initialise(args)
        # Before the node logs that it is ready: an executor made after a signal has shut the context down complains.
        executor = SingleThreadedExecutor()
        node = make_node()
        node.start()
        executor.add_node(node)
        executor.spin()
    except ExternalShutdownException:
        pass
    except OffradarError as error:
        print(f'error: {error}', file=sys.stderr)
        status = 1
    except Exception:
        # A callback that ran when the context was shut down cannot publish any more.
        if rclpy.ok():
            raise
    finally:
        if node is not None:
            status = max(status, _close(node))
            node.destroy_node()
        rclpy.try_shutdown()
    return status


def _stray(argv: list[str]) -> list[str]:
    try:
        return list(remove_ros_args(argv)[1:])
    except Exception:
        # `_initialise` reports what is wrong with the ROS arguments.
        return []


def _initialise(args: list[str] | None) -> None:
    try:
        rclpy.init(args=args)
    except Exception as error:
        # A parameter file that is missing or malformed, or an argument that ROS cannot read.
        raise OffradarError(f'ROS arguments: {str(error).splitlines()[0]}') from error


def _close(node: StageNode) -> int:
    try:
        node.close()
    except OffradarError as error:
        print(f'error: {error}', file=sys.stderr)
        try:
            rescued = node.rescue()
        except OffradarError as failed:
            rescued = f'error: {failed}'
        if rescued:
            print(rescued, file=sys.stderr)
        return 1
    return 0
