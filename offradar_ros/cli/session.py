"""`offradar session`: the map server's services, also without the ros2 command."""

import enum
import importlib.util
import signal
from collections.abc import Callable
from functools import partial
from typing import Annotated

import typer

from offradar_ros.cli.install_hints import ros_hint
from offradar_ros.cli.interrupt import Signalled, held_signals
from offradar_ros.errors import OffradarError


class Action(str, enum.Enum):
    """An action of the map server."""

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
    action: Annotated[Action, typer.Argument(help='What the map server is to do.')],
    timeout: Annotated[float, typer.Option(min=0.1, max=3600.0, help='Longest wait for the map server, s.')] = 60.0,
    namespace: Annotated[str, typer.Option(help='Namespace of the map server, such as /car_1.')] = '',
) -> None:
    """Start, end, undo or save a session of the running map server, or clear its map, and print its answer."""
    if importlib.util.find_spec('rclpy') is None:
        raise OffradarError(f'this command {ros_hint("rclpy", "ros")}')
    from offradar_ros.ros.shared_memory import shared_memory_problem  # noqa: PLC0415

    if problem := shared_memory_problem():
        raise OffradarError(problem)
    # From here on, because importing ROS takes time too.
    with held_signals(signal.SIGINT, signal.SIGTERM) as check:
        _call(SERVICES[action], timeout, namespace, check)


def _call(service: str, timeout: float, namespace: str, check: Callable[[], None]) -> None:
    # Imported here: the other commands work without ROS.
    import rclpy  # noqa: PLC0415
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    from rclpy.validate_namespace import validate_namespace  # noqa: PLC0415

    from offradar_ros.ros.initialise import initialise, refusals_of_ros  # noqa: PLC0415
    from offradar_ros.ros.session_client import SessionClient  # noqa: PLC0415

    initialise([], signal_handler_options=SignalHandlerOptions.NO)
    with refusals_of_ros():
        if namespace:
            # Before a node is made with it: rclpy complains on stderr about one that it gives up.
            validate_namespace(f'/{namespace.lstrip("/")}')
        node = rclpy.create_node('offradar_session', namespace=namespace)
    client = SessionClient(node, timeout, report=partial(typer.echo, err=True), check=check)
    try:
        typer.echo(client.call(service))
    except Signalled as signalled:
        typer.echo(f'interrupted while waiting for {client.waiting_for}', err=True)
        raise typer.Exit(signalled.status) from None
    finally:
        node.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.try_shutdown()
