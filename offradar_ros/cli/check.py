"""`offradar check`: the contents of a data-set folder or a bag, and every problem."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console

from offradar_ros.cli.bag_topics import Positions, Topic
from offradar_ros.cli.check_set import CheckOptions, Section, check_set
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import load_config
from offradar_ros.errors import ConfigError
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.check import check_recording
from offradar_ros.recordings.datasets.check import Finding
from offradar_ros.recordings.datasets.splits import read_split
from offradar_ros.recordings.source import LAYOUT_HELP, recordings_in, require_recording

STYLES = {'ok': 'green', 'note': 'yellow', 'problem': 'red'}


def check(
    folder: Annotated[
        Path, typer.Argument(help='Data-set folder, rosbag2 folder or file, or a folder of several such folders.')
    ],
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
    topic: Topic = '',
    positions: Positions = '',
    params: Annotated[
        Optional[Path], typer.Option(help='Parameter file: how to read the radar, and position.max_gap_s.')
    ] = None,
    sample: Annotated[
        int, typer.Option(min=0, help='Decode this many scans of each sequence, evenly spread; 0 decodes all.')
    ] = 0,
    split: Annotated[
        str, typer.Option(help='Of a folder of several: a split to compare it with, oxford, mulran or a YAML file.')
    ] = '',
    processes: Annotated[
        int, typer.Option(min=0, max=256, help='Processes for a folder of several; 0 for one a core.')
    ] = 0,
) -> None:
    """Print the contents and every problem; exit status 1 if there is a problem."""
    config = load_config(params)
    topics = ChosenTopics(topic, positions)
    split_record = read_split(split) if split else None
    inside = recordings_in(folder, layout)
    console = Console(soft_wrap=True)
    if len(inside) > 1 or (inside and split_record):
        options = CheckOptions(layout, config.radar, config.position, sample, topics)
        _print_all(console, check_set(folder, inside, options, split_record, processes))
        return
    require_recording(folder, layout)
    if split_record:
        raise ConfigError(f'--split: expected a folder of sequences, got {folder}, which is one')
    with progress_bar(f'checking {folder.name}') as progress:
        found = check_recording(
            folder,
            layout,
            radar=config.radar,
            position=config.position,
            topics=topics,
            sample=sample,
            progress=progress,
        )
    _print(console, found.findings)
    if found.problems:
        raise typer.Exit(1)


def _print_all(console: Console, sections: Sequence[Section]) -> None:
    wrong = []
    for heading, findings in sections:
        console.print(heading, style='bold', markup=False, highlight=False)
        _print(console, findings)
        console.print()
        if any(finding.level == 'problem' for finding in findings):
            wrong.append(heading)
    console.print(f'problems: {", ".join(wrong)}' if wrong else 'no problems', markup=False, highlight=False)
    if wrong:
        raise typer.Exit(1)


def _print(console: Console, findings: Sequence[Finding]) -> None:
    for finding in findings:
        console.print(f'{finding.level:8}', style=STYLES[finding.level], end='')
        console.print(finding.text, markup=False, highlight=False)
