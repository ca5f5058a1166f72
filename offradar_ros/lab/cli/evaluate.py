"""`offradar evaluate`: recall, uncertainty and map maintenance of encoders, by a protocol."""

import importlib.util
import shlex
import sys
from pathlib import Path
from typing import Annotated, Optional

import typer
from rich.console import Console

from offradar_ros.cli.bag_topics import Positions, Topic
from offradar_ros.cli.install_hints import pip_hint
from offradar_ros.cli.interrupt import resumable
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import RadarConfig, load_config, read_parameters
from offradar_ros.errors import ConfigError
from offradar_ros.lab.cli.evaluation_options import (
    DEFAULT_METHODS,
    Data,
    ExclusionS,
    LeaveOutM,
    Maps,
    Methods,
    Params,
    Processes,
    ProtocolName,
    Queries,
    Streets,
    Threads,
    print_note,
    protocol_of,
)
from offradar_ros.lab.evaluation.evaluate import ALIGNED, Options
from offradar_ros.lab.evaluation.evaluate import evaluate as run
from offradar_ros.lab.evaluation.recorded_drives import RecordedSource
from offradar_ros.lab.evaluation.recorded_uncertainty import RecordedScans
from offradar_ros.lab.evaluation.results.file import RESULTS_FILE
from offradar_ros.lab.evaluation.table import tables
from offradar_ros.lab.evaluation.thresholds import NOT_DEPLOYED, Deployed
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.retrieval.thresholds import threshold_at

THRESHOLD = frozenset({'query.delta', 'query.levels', 'query.level'})


def evaluate(
    protocol: ProtocolName = None,
    methods: Methods = None,
    out: Annotated[Path, typer.Option(help='Folder for results.json, scans.npy, maps.npz and pictures.')] = Path(
        'evaluation'
    ),
    data: Data = None,
    maps: Maps = None,
    queries: Queries = None,
    exclusion_s: ExclusionS = None,
    leave_out_m: LeaveOutM = None,
    topic: Topic = '',
    positions: Positions = '',
    params: Params = None,
    streets: Streets = None,
    clean_scans: Annotated[
        Optional[Path],
        typer.Option(
            help='A recording in good conditions: U of its scans, as recorded and with faults added to their bytes.'
        ),
    ] = None,
    compared_scans: Annotated[
        Optional[list[str]],
        typer.Option(
            metavar='NAME=RECORDING',
            help='Another recording, whose U is compared with that of the clean scans. May be repeated.',
        ),
    ] = None,
    cache: Annotated[
        Optional[Path], typer.Option(help='Folder of simulated scans and embeddings, kept; OUT/cache if not given.')
    ] = None,
    processes: Processes = 0,
    threads: Threads = 0,
    alignments: Annotated[
        int,
        typer.Option(
            min=0,
            metavar='N',
            help='Queries of each pair of drives that are aligned with the nearest places of each map, for methods '
            'that are not fitted to each map; 0 for none.',
        ),
    ] = ALIGNED,
    pictures: Annotated[bool, typer.Option(help='Draw pictures (needs matplotlib).')] = True,
) -> None:
    """Compare encoders on drives of a protocol; an interrupted run continues where it stopped."""
    if pictures and importlib.util.find_spec('matplotlib') is None:
        raise ConfigError(f'pictures need the Python package matplotlib: {pip_hint("plot")}, or --no-pictures')
    config = load_config(params)
    in_use = params is not None and not THRESHOLD.isdisjoint(read_parameters(params))
    options = Options(
        out=out,
        cache=cache or out / 'cache',
        command=shlex.join(['offradar', *sys.argv[1:]]),
        bar=progress_bar,
        note=print_note,
        streets=streets,
        recorded_scans=_recorded_scans(clean_scans, compared_scans or [], config.radar),
        recorded=RecordedSource(data, config.radar, config.position, ChosenTopics(topic, positions)),
        encoder=config.encoder,
        deployed=Deployed(threshold_at(config.query), config.query.model) if in_use else NOT_DEPLOYED,
        query=config.query,
        processes=processes,
        threads=threads,
        pictures=pictures,
        alignments=alignments,
    )
    with resumable():
        results = run(
            protocol_of(protocol, maps, queries, exclusion_s, leave_out_m), methods or DEFAULT_METHODS, options
        )
    console = Console()
    for table in tables(results):
        console.print(table)
    typer.echo(f'{out / RESULTS_FILE}: written; offradar report {out} makes tables and figures from it')


def _recorded_scans(clean: Path | None, compared: list[str], radar: RadarConfig) -> RecordedScans | None:
    """The recordings of the two options; ConfigError if they are malformed."""
    named: dict[str, Path] = {}
    for text in compared:
        name, _, path = text.partition('=')
        if clean is None or not name or not path or name in named:
            raise ConfigError(
                f'--compared-scans {text}: expected NAME=RECORDING, each name once, with --clean-scans RECORDING'
            )
        named[name] = Path(path)
    return None if clean is None else RecordedScans(clean, named, radar)
