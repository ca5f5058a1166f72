"""`offradar convert`: a data-set folder to a rosbag2 folder."""

import dataclasses
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from offradar_ros.bags.reader import Bag
from offradar_ros.bags.writer import BagOptions, write_bag
from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import LAYOUT_HELP, open_source
from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.datasets.check.coverage import coverage
from offradar_ros.datasets.check.findings import counted
from offradar_ros.datasets.sequence import RadarSequence
from offradar_ros.errors import ConfigError, DataError, OffradarError

LARGEST_OFFSET_S = 1e9


def convert(
    source: Annotated[Path, typer.Argument(help='Data-set folder (or another bag).')],
    out: Annotated[Path, typer.Argument(help='rosbag2 folder to write.')],
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
    plain: Annotated[
        bool, typer.Option('--plain', help="Leave out the 11 metadata columns, as Navtech's driver does.")
    ] = False,
    position_offset_s: Annotated[
        float, typer.Option(help='Seconds added to the stamps of positions, for clocks that disagree.')
    ] = 0.0,
    overwrite: Annotated[bool, typer.Option('--overwrite', help='Replace an existing bag.')] = False,
    skip_unreadable: Annotated[
        bool, typer.Option('--skip-unreadable', help='Leave out scans that cannot be read, and name them at the end.')
    ] = False,
) -> None:
    """Write radar_data/b_scan_image, gps/fix and ground_truth/odometry as MCAP with zstd chunks."""
    if not abs(position_offset_s) <= LARGEST_OFFSET_S:
        raise ConfigError(
            f'--position-offset-s: expected seconds within ±{LARGEST_OFFSET_S:g}, got {position_offset_s:g}'
        )
    sequence = open_source(source, layout, RadarConfig())
    options = BagOptions(plain=plain, position_offset_ns=round(position_offset_s * 1e9), overwrite=overwrite)
    existed = out.exists()
    skipped: dict[int, OffradarError] = {}

    def skip(index: int, error: OffradarError) -> None:
        if not skip_unreadable:
            raise DataError(f'{error} (--skip-unreadable leaves such scans out)') from error
        skipped[index] = error

    with progress_bar(f'converting {sequence.name}') as progress:
        write_bag(sequence, out, options, progress, skip)
    with Bag(out) as bag:
        for topic, count in bag.counts.items():
            typer.echo(f'{topic}: {counted(count, "message")}')
    if skipped:
        typer.echo(f'skipped {len(skipped)} of {counted(len(sequence), "scan")} that cannot be read:')
        for error in skipped.values():
            typer.echo(f'  {error}')
    written_ns = np.delete(sequence.stamps_ns, list(skipped))
    lack = _lack_of_positions(sequence, written_ns, position_offset_s)
    if lack:
        typer.echo(f'warning: {lack}')
    typer.echo(f'{out}: {"replaced" if existed else "written"}')


def _lack_of_positions(sequence: RadarSequence, scans_ns: NDArray[np.int64], offset_s: float) -> str:
    """Which scans have no position and why, in the words of `offradar check`; empty where none lacks one."""
    trajectory = sequence.trajectory
    if trajectory is None:
        return 'no positions: the source has none; this bag can be queried with, not mapped'
    moved = dataclasses.replace(trajectory, stamps_ns=trajectory.stamps_ns + round(offset_s * 1e9))
    found = coverage('positions', scans_ns, moved, PositionConfig().max_gap_s, offset_s)
    return found.text if found.level == 'problem' else ''
