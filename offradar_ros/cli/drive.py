"""`offradar drive`: a bag through the whole pipeline without ROS, at full CPU speed."""

from collections import Counter
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.table import Table

from offradar_ros.bags.reader import Bag
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import MapError
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.pipeline import DriveResult
from offradar_ros.pipeline import drive as drive_through
from offradar_ros.types import Match


def drive(
    bag: Annotated[Path, typer.Argument(help='rosbag2 folder.')],
    params: Annotated[Optional[Path], typer.Option(help='Parameter file, as the nodes read it.')] = None,
    map_path: Annotated[Optional[Path], typer.Option('--map', help='SQLite map file; in memory if left out.')] = None,
    session: Annotated[Optional[str], typer.Option(help='Map the drive as a session of this name.')] = None,
) -> None:
    """Encode, map and query every scan of a bag, exactly as the nodes do."""
    config = load_config(params, {'map.path': str(map_path)} if map_path else None)
    if session is None and config.map.path and not Path(config.map.path).exists():
        raise MapError(f'{config.map.path}: no map file there: --session NAME starts one')
    encoder = make_encoder(config.encoder)
    with (
        Bag(bag) as opened,
        SessionMap(config.map) as session_map,
        progress_bar(f'driving {bag.name}') as progress,
    ):
        result = drive_through(opened, config, encoder, session_map, session=session, progress=progress)
    _print(result)


def _print(result: DriveResult) -> None:
    answers = Counter('match' if isinstance(o, Match) else f'rejected: {o.reason.value}' for o in result.outcomes)
    table = Table('answer', 'scans')
    for answer, count in sorted(answers.items()):
        table.add_row(answer, str(count))
    for cause, count in sorted(result.refused.items()):
        table.add_row(f'dropped: {cause}', str(count))
    Console().print(table)
    if result.report:
        typer.echo(result.report.summary())
