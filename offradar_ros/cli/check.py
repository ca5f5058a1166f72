"""`offradar check`: what a data-set folder or a bag holds."""

from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console

from offradar_ros.bags.check import check_bag
from offradar_ros.bags.reader import is_bag
from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import LAYOUT_HELP, require_recording
from offradar_ros.config import load_config
from offradar_ros.datasets.check import check_folder

STYLES = {'ok': 'green', 'note': 'yellow', 'problem': 'red'}


def check(
    folder: Annotated[Path, typer.Argument(help='Data-set folder, rosbag2 folder or MCAP file.')],
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
    params: Annotated[
        Optional[Path], typer.Option(help='Parameter file: how to read the radar, and position.max_gap_s.')
    ] = None,
    sample: Annotated[int, typer.Option(min=0, help='Decode this many scans, evenly spread; 0 decodes all.')] = 0,
) -> None:
    """Say what is there and everything that is wrong with it; exit status 1 if anything is."""
    config = load_config(params)
    radar, position = config.radar, config.position
    require_recording(folder, layout)
    with progress_bar(f'checking {folder.name}') as progress:
        found = (
            check_bag(folder, radar, position)
            if is_bag(folder)
            else check_folder(folder, layout, radar=radar, position=position, sample=sample, progress=progress)
        )
    console = Console(soft_wrap=True)
    for finding in found.findings:
        console.print(f'{finding.level:8}', style=STYLES[finding.level], end='')
        console.print(finding.text, markup=False, highlight=False)
    if found.problems:
        raise typer.Exit(1)
