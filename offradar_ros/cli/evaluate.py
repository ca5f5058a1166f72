"""`offradar evaluate`: recall, uncertainty and map maintenance of encoders, by a protocol."""

import importlib.util
import shlex
import sys
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console

from offradar_ros.cli.need import pip_hint
from offradar_ros.cli.progress import progress_bar
from offradar_ros.errors import ConfigError
from offradar_ros.evaluation.evaluate import Options
from offradar_ros.evaluation.evaluate import evaluate as run
from offradar_ros.evaluation.protocol_file import read_protocol
from offradar_ros.evaluation.table import tables


def evaluate(
    protocol: Annotated[Path, typer.Argument(help='Protocol, as those of params/protocols.')],
    methods: Annotated[
        list[str],
        typer.Option(
            '--method',
            metavar='NAME[=WEIGHTS]',
            help='ours, bc_radar, vae, mc_dropout, stun with weights; ring_key; rad_vlad, fitted to each map unless '
            'weights are given. Another NAME is a variant of ours. May be repeated.',
        ),
    ],
    out: Annotated[Path, typer.Option(help='Folder for results.json, scans.npy and pictures.')],
    real_worlds: Annotated[
        Optional[Path], typer.Option(help='Folder of the maps and traversals that the protocol names.')
    ] = None,
    real_scans: Annotated[
        Optional[Path], typer.Option(help='Folder of oxford_tiny and radiate_tiny_foggy: U of recorded scans.')
    ] = None,
    cache: Annotated[
        Optional[Path], typer.Option(help='Folder of simulated scans and embeddings, kept; OUT/cache if not given.')
    ] = None,
    processes: Annotated[int, typer.Option(min=0, help='Processes that simulate; 0 for one a core.')] = 0,
    threads: Annotated[int, typer.Option(min=0, help='Threads of a learned encoder; 0 for one a core.')] = 0,
    pictures: Annotated[bool, typer.Option(help='Draw pictures (needs matplotlib).')] = True,
) -> None:
    """Measure encoders on drives that none of them was trained on; goes on where it was interrupted."""
    if pictures and importlib.util.find_spec('matplotlib') is None:
        raise ConfigError(f'pictures need the Python package matplotlib: {pip_hint("plot")}, or --no-pictures')
    options = Options(
        out=out,
        cache=cache or out / 'cache',
        command=shlex.join(['offradar', *sys.argv[1:]]),
        bar=progress_bar,
        real_worlds=real_worlds,
        real_scans=real_scans,
        processes=processes,
        threads=threads,
        pictures=pictures,
    )
    results = run(read_protocol(protocol), methods, options)
    console = Console()
    for table in tables(results):
        console.print(table)
    for text in results['skipped']:
        typer.echo(f'note: left out: {text}')
    typer.echo(f'{out / "results.json"}: written')
