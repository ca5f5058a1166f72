"""`offradar demo`: mapping and querying simulated drives with the real nodes."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from offradar_ros.cli.install_hints import ros_hint
from offradar_ros.cli.progress import progress_bar
from offradar_ros.errors import OffradarError


def demo(
    out: Annotated[Path, typer.Option(help='Folder for all output; emptied first.')] = Path('demo_output'),
    domain_id: Annotated[int, typer.Option(min=0, max=101, help='ROS domain of the nodes.')] = 90,
) -> None:
    """Simulate three drives, replay them through the nodes over DDS, and print and draw the results."""
    for package, extra in (('rclpy', 'ros'), ('matplotlib', 'plot')):
        if importlib.util.find_spec(package) is None:
            raise OffradarError(f'the demo {ros_hint(package, extra)}')
    # Only the demonstration needs ROS; the other commands run without it.
    from offradar_ros.lab.demo.run import run_demo  # noqa: PLC0415

    run_demo(out, domain_id, progress_bar)
