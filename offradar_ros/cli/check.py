"""`offradar check`: what a data-set folder or a bag holds."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from offradar_ros.bags.check import check_bag
from offradar_ros.bags.reader import is_bag
from offradar_ros.cli.progress import progress_bar
from offradar_ros.datasets.check import check_folder
from offradar_ros.errors import DataError

STYLES = {'ok': 'green', 'note': 'yellow', 'problem': 'red'}


def check(
    folder: Annotated[Path, typer.Argument(help='Data-set folder, rosbag2 folder or MCAP file.')],
    layout: Annotated[str, typer.Option(help='Layout of the folder; auto recognises it.')] = 'auto',
    sample: Annotated[int, typer.Option(min=0, help='Decode this many scans, evenly spread; 0 decodes all.')] = 0,
) -> None:
    """Say what is there and everything that is wrong with it; exit status 1 if anything is."""
    if not folder.exists():
        raise DataError(f'{folder}: no such folder')
    with progress_bar(f'checking {folder.name}') as progress:
        found = check_bag(folder) if is_bag(folder) else check_folder(folder, layout, sample=sample, progress=progress)
    console = Console(soft_wrap=True)
    for finding in found.findings:
        console.print(f'{finding.level:8}', style=STYLES[finding.level], end='')
        console.print(finding.text, markup=False, highlight=False)
    if found.problems:
        raise typer.Exit(1)
