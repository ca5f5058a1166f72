"""`offradar evaluate`: recall, uncertainty and map maintenance of encoders, by a protocol."""

import dataclasses
import importlib.util
import math
import shlex
import sys
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console

from offradar_ros.cli.need import pip_hint
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import load_config, read_parameters
from offradar_ros.errors import ConfigError
from offradar_ros.evaluation.evaluate import RESULTS, Options
from offradar_ros.evaluation.evaluate import evaluate as run
from offradar_ros.evaluation.protocol import Group, Protocol, Recorded
from offradar_ros.evaluation.protocol_file import read_protocol
from offradar_ros.evaluation.recorded_drives import RecordedSource
from offradar_ros.evaluation.table import tables
from offradar_ros.retrieval.thresholds import threshold_at

METHODS_HELP = (
    'ours, bc_radar, vae, mc_dropout, stun with weights; ring_key; rad_vlad, fitted to each map unless weights are '
    'given. Another NAME is a variant of ours. May be repeated.'
)
DEPLOYED = frozenset({'query.delta', 'query.levels', 'query.level'})


def evaluate(
    protocol: Annotated[
        str, typer.Argument(help='Protocol: a YAML file, or the name of one that comes with us.')
    ] = 'simulated',
    methods: Annotated[
        Optional[list[str]], typer.Option('--method', metavar='NAME[=WEIGHTS]', help=METHODS_HELP)
    ] = None,
    out: Annotated[Path, typer.Option(help='Folder for results.json, scans.npy, maps.npz and pictures.')] = Path(
        'evaluation'
    ),
    data: Annotated[Optional[Path], typer.Option(help='Folder of the recorded sequences that it names.')] = None,
    maps: Annotated[
        Optional[list[Path]],
        typer.Option(
            '--map',
            help='A recording of your own, mapped, in place of what the protocol drives; the others '
            'given are merged into it for M.',
        ),
    ] = None,
    queries: Annotated[
        Optional[list[Path]], typer.Option('--query', help='A recording of your own, searched for in the maps.')
    ] = None,
    params: Annotated[
        Optional[Path],
        typer.Option(help='Parameter file: how recordings are read, and the threshold in use where it has one.'),
    ] = None,
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
    config = load_config(params)
    deployed = params is not None and not DEPLOYED.isdisjoint(read_parameters(params))
    options = Options(
        out=out,
        cache=cache or out / 'cache',
        command=shlex.join(['offradar', *sys.argv[1:]]),
        bar=progress_bar,
        real_worlds=real_worlds,
        real_scans=real_scans,
        recorded=RecordedSource(data, config.radar, config.position),
        threshold=threshold_at(config.query) if deployed else math.nan,
        processes=processes,
        threads=threads,
        pictures=pictures,
    )
    results = run(of_own(read_protocol(protocol), maps or [], queries or []), methods or ['ring_key'], options)
    console = Console()
    for table in tables(results):
        console.print(table)
    for text in results['skipped']:
        typer.echo(f'note: {text}')
    typer.echo(f'{out / RESULTS}: written')


def of_own(protocol: Protocol, maps: list[Path], queries: list[Path]) -> Protocol:
    """The protocol with recordings of one's own in place of its groups, where any are given."""
    if not maps and not queries:
        return protocol
    if not maps or not queries:
        raise ConfigError('--map and --query: expected at least one of each')
    named = [[str(path.resolve()) for path in paths] for paths in (maps, queries)]
    road = Recorded('own', maps=tuple(named[0]), queries=tuple(named[1]))
    return dataclasses.replace(protocol, groups=(Group('own', 'Own recordings', recorded=(road,)),))
