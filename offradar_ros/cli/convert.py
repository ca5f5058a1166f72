"""`offradar convert`: a data-set folder to a rosbag2 folder."""

from pathlib import Path
from typing import Annotated

import typer

from offradar_ros.bags.reader import Bag
from offradar_ros.bags.topics import FIX, ODOMETRY
from offradar_ros.bags.writer import BagOptions, write_bag
from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import open_source
from offradar_ros.config import RadarConfig
from offradar_ros.errors import ConfigError

LARGEST_OFFSET_S = 1e9


def convert(
    source: Annotated[Path, typer.Argument(help='Data-set folder (or another bag).')],
    out: Annotated[Path, typer.Argument(help='rosbag2 folder to write.')],
    layout: Annotated[str, typer.Option(help='Layout of the folder; auto recognises it.')] = 'auto',
    plain: Annotated[
        bool, typer.Option('--plain', help="Leave out the 11 metadata columns, as Navtech's driver does.")
    ] = False,
    position_offset_s: Annotated[
        float, typer.Option(help='Seconds added to the stamps of positions, for clocks that disagree.')
    ] = 0.0,
    overwrite: Annotated[bool, typer.Option('--overwrite', help='Replace an existing bag.')] = False,
) -> None:
    """Write radar_data/b_scan_image, gps/fix and ground_truth/odometry as MCAP with zstd chunks."""
    if not abs(position_offset_s) <= LARGEST_OFFSET_S:
        raise ConfigError(
            f'--position-offset-s: expected seconds within ±{LARGEST_OFFSET_S:g}, got {position_offset_s:g}'
        )
    sequence = open_source(source, layout, RadarConfig())
    options = BagOptions(plain=plain, position_offset_ns=round(position_offset_s * 1e9), overwrite=overwrite)
    with progress_bar(f'converting {sequence.name}') as progress:
        write_bag(sequence, out, options, progress)
    with Bag(out) as bag:
        for topic, count in bag.counts.items():
            typer.echo(f'{topic}: {count} messages')
        if sequence.trajectory is None:
            typer.echo('no positions: the source has none; this bag can be queried with, not mapped')
        elif FIX not in bag.topics and ODOMETRY not in bag.topics:
            typer.echo(
                'no positions: the source has none within 5 s of its scans (see offradar check, --position-offset-s); '
                'this bag can be queried with, not mapped'
            )
    typer.echo(f'{out}: written')
