"""Start and stop of a node process: exit status 0 on SIGINT, double SIGINT and SIGTERM, 1 with one line on an error."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from offradar_ros.errors import OffradarError
from offradar_ros.ros.stage_node import StageNode


def run(make_node: Callable[[], StageNode], args: list[str] | None = None) -> int:
    """Spin the node until the context is shut down; the exit status."""
    # rclpy's own handler still shuts the context down. Without this, a second SIGINT (ros2 launch sends two) raises
    # KeyboardInterrupt in the middle of the clean-up.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    node: StageNode | None = None
    try:
        rclpy.init(args=args)
        node = make_node()
        node.start()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    except ExternalShutdownException:
        pass
    except OffradarError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    finally:
        if node is not None:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
