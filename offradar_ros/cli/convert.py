"""`offradar convert`: a data-set folder to a rosbag2 folder, or each of several to its own."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.cli.bag_topics import Positions, Topic
from offradar_ros.cli.conversion import Conversion, as_recorded, convert_sequence
from offradar_ros.cli.convert_set import ConvertOptions, convert_set
from offradar_ros.cli.outputs import require_beside
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import load_config
from offradar_ros.errors import ConfigError
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.bags.writer import BagOptions
from offradar_ros.recordings.datasets.check.coverage import LARGEST_OFFSET_S
from offradar_ros.recordings.datasets.check.findings import counted
from offradar_ros.recordings.source import LAYOUT_HELP, open_source, recordings_in


def convert(
    source: Annotated[Path, typer.Argument(help='Data-set folder (or another bag), or a folder of several.')],
    out: Annotated[
        Path, typer.Argument(help='rosbag2 folder to write; for several, the folder that will hold one for each.')
    ],
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
    topic: Topic = '',
    positions: Positions = '',
    params: Annotated[Optional[Path], typer.Option(help='Parameter file: how the source is read (radar.*).')] = None,
    plain: Annotated[
        bool, typer.Option('--plain', help="Leave out the 11 metadata columns, as Navtech's driver does.")
    ] = False,
    position_offset_s: Annotated[
        float, typer.Option(help='Seconds added to the stamps of positions, for clocks that disagree.')
    ] = 0.0,
    overwrite: Annotated[
        bool,
        typer.Option(
            '--overwrite',
            help='Replace existing bags; else one is an error, and among several it is kept.',
        ),
    ] = False,
    skip_unreadable: Annotated[
        bool, typer.Option('--skip-unreadable', help='Leave out scans that cannot be read, and name them at the end.')
    ] = False,
    processes: Annotated[
        int, typer.Option(min=0, max=256, help='Processes for a folder of several; 0 for one a core.')
    ] = 0,
) -> None:
    """Write radar_data/b_scan_image, gps/fix and ground_truth/odometry as MCAP with zstd chunks."""
    if not abs(position_offset_s) <= LARGEST_OFFSET_S:
        raise ConfigError(
            f'--position-offset-s: expected seconds within ±{LARGEST_OFFSET_S:g}, got {position_offset_s:g}'
        )
    options = BagOptions(plain=plain, position_offset_ns=round(position_offset_s * 1e9), overwrite=overwrite)
    topics = ChosenTopics(topic, positions)
    radar = as_recorded(load_config(params).radar)
    inside = recordings_in(source, layout)
    if len(inside) > 1:
        _convert_several(
            source, inside, out, ConvertOptions(layout, topics, options, skip_unreadable, radar), processes
        )
        return
    sequence = open_source(source, layout, radar, topics)
    require_beside(source, out)
    existed = out.exists()
    with progress_bar(f'converting {sequence.name}') as progress:
        made = convert_sequence(sequence, out, options, skip_unreadable, progress)
    with Bag(out) as bag:
        for written, count in bag.counts.items():
            typer.echo(f'{written}: {counted(count, "message")}')
    _report(made)
    typer.echo(f'{out}: {"replaced" if existed else "written"}')


def _convert_several(root: Path, sources: list[Path], out: Path, options: ConvertOptions, processes: int) -> None:
    if out.resolve() == root.resolve():
        raise ConfigError(f'{out}: expected another folder than the one that holds the sequences')
    with progress_bar(f'converting {root.name}') as progress:
        outcomes = convert_set(sources, out, options, processes, progress)
    for path, outcome in outcomes.items():
        if outcome is None:
            typer.echo(f'{path}: there already')
        elif isinstance(outcome, Conversion):
            typer.echo(f'{path}: written, {counted(outcome.scans - len(outcome.skipped), "scan")}')
            _report(outcome)
    failures = [f'{path}: {outcome}' for path, outcome in outcomes.items() if isinstance(outcome, str)]
    for failure in failures:
        typer.echo(f'error: {failure}', err=True)
    if failures:
        typer.echo(f'{len(failures)} of {len(sources)} sequences not converted', err=True)
        raise typer.Exit(1)


def _report(made: Conversion) -> None:
    if made.skipped:
        typer.echo(f'skipped {len(made.skipped)} of {counted(made.scans, "scan")} that cannot be read:')
        for error in made.skipped:
            typer.echo(f'  {error}')
    for warning in (*made.warnings, made.position_problem):
        if warning:
            typer.echo(f'warning: {warning}')
