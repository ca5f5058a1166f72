"""`offradar session`: the map server's services, where there is no ros2 command."""

import enum
import importlib.util
from typing import Annotated

import typer

from offradar_ros.cli.need import ros_hint
from offradar_ros.errors import OffradarError


class Action(str, enum.Enum):
    """What can be asked of the map server."""

    START = 'start'
    END = 'end'
    UNDO = 'undo'
    SAVE = 'save'
    CLEAR = 'clear'


SERVICES = {
    Action.START: 'start_session',
    Action.END: 'end_session',
    Action.UNDO: 'undo_session',
    Action.SAVE: 'save',
    Action.CLEAR: 'clear',
}


def session(
    action: Annotated[Action, typer.Argument(help='What to ask of the map server.')],
    timeout: Annotated[float, typer.Option(min=0.1, max=3600.0, help='Longest wait for the map server, s.')] = 60.0,
) -> None:
    """Start, end, undo or save a session of the running map server, or clear its map, and print what it says."""
    if importlib.util.find_spec('rclpy') is None:
        raise OffradarError(f'this command {ros_hint("rclpy", "ros")}')
    # Only this needs ROS: the other commands work without it.
    import rclpy  # noqa: PLC0415
    from rclpy.executors import ExternalShutdownException  # noqa: PLC0415

    from offradar_ros.ros.sessions import SessionClient  # noqa: PLC0415

    rclpy.init(args=[])
    node = rclpy.create_node('offradar_session')
    try:
        typer.echo(SessionClient(node, timeout).call(SERVICES[action]))
    except ExternalShutdownException:
        raise typer.Exit(130) from None
    finally:
        node.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.try_shutdown()
