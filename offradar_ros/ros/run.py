"""Start and stop of a node process: exit status 0 on SIGINT (also twice), SIGTERM and SIGHUP, 1 with one line on an
error."""

from __future__ import annotations

import signal
import sys
import time
import traceback
from collections.abc import Callable

import rclpy
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor

from offradar_ros.entry_point import report, run_guarded
from offradar_ros.errors import OffradarError, RefusedInput
from offradar_ros.ros.initialise import end_on_hang_up, initialise, own_arguments, refusals_of_ros
from offradar_ros.ros.parameter_files import not_addressed
from offradar_ros.ros.stage_node import StageNode

USAGE = (
    'Usage: NODE --ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO]. '
    '`offradar parameters` lists the parameters.'
)
FAILED_S = 0.01
"""Pause after a callback that failed: one that fails at once, again and again, must not take all of the CPU."""


def run(make_node: Callable[[], StageNode], args: list[str] | None = None) -> int:
    """Spin the node until the context is shut down; the exit status."""
    return run_guarded(lambda: _run(make_node, sys.argv if args is None else ['', *args]))


def _run(make_node: Callable[[], StageNode], argv: list[str]) -> int:
    stray = own_arguments(argv)
    if stray:
        if stray[0] in ('-h', '--help'):
            print(USAGE)
            return 0
        print(f'error: argument {stray[0]!r} is unknown. {USAGE}', file=sys.stderr)
        return 2
    # rclpy's own handler still shuts the context down. Without this, a second SIGINT (ros2 launch sends two) raises
    # KeyboardInterrupt in the middle of the clean-up.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_on_hang_up()
    node: StageNode | None = None
    status = 0
    try:
        initialise(argv)
        # Before the node logs that it is ready: an executor made after a signal has shut the context down complains.
        executor = SingleThreadedExecutor()
        with refusals_of_ros():
            node = make_node()
        for line in not_addressed(argv, node.get_fully_qualified_name()):
            node.get_logger().warning(line)
        node.start()
        executor.add_node(node)
        _spin(executor, node)
    except ExternalShutdownException:
        pass
    except OffradarError:
        raise
    except Exception:
        # A start that was interrupted cannot publish any more.
        if rclpy.ok():
            raise
    finally:
        if node is not None:
            status = max(status, _close(node))
            node.destroy_node()
        rclpy.try_shutdown()
    return status


def _spin(executor: Executor, node: StageNode) -> None:
    """Handle callbacks until the context is shut down; one that fails ends itself, not the node."""
    while rclpy.ok():
        try:
            executor.spin()
        except ExternalShutdownException:
            return
        except Exception:
            if rclpy.ok():
                node.refuse(RefusedInput('internal_error', traceback.format_exc()), 'callback')
                time.sleep(FAILED_S)


def _close(node: StageNode) -> int:
    try:
        node.close()
    except Exception as error:
        report(error)
        try:
            rescued = node.rescue()
        except Exception as failed:
            report(failed)
        else:
            if rescued:
                print(rescued, file=sys.stderr)
        return 1
    return 0
