"""`offradar encode`: embeddings of the drives of a protocol, for `offradar evaluate`."""

from pathlib import Path
from typing import Annotated

import typer

from offradar_ros.cli.bag_topics import Positions, Topic
from offradar_ros.cli.interrupt import resumable
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import load_config
from offradar_ros.lab.cli.evaluation_options import (
    DEFAULT_METHODS,
    Data,
    ExclusionS,
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
from offradar_ros.lab.evaluation.evaluate import Options, encode_drives
from offradar_ros.lab.evaluation.recorded_drives import RecordedSource
from offradar_ros.recordings.bags.topics import ChosenTopics


def encode(
    protocol: ProtocolName = None,
    methods: Methods = None,
    cache: Annotated[Path, typer.Option(help='Folder of simulated scans and embeddings, as for evaluate.')] = (
        Path('evaluation') / 'cache'
    ),
    data: Data = None,
    maps: Maps = None,
    queries: Queries = None,
    exclusion_s: ExclusionS = None,
    topic: Topic = '',
    positions: Positions = '',
    params: Params = None,
    streets: Streets = None,
    processes: Processes = 0,
    threads: Threads = 0,
) -> None:
    """Encode every drive of a protocol; an interrupted run continues where it stopped."""
    config = load_config(params)
    options = Options(
        out=cache,
        cache=cache,
        command='',
        bar=progress_bar,
        note=print_note,
        streets=streets,
        recorded=RecordedSource(data, config.radar, config.position, ChosenTopics(topic, positions)),
        encoder=config.encoder,
        processes=processes,
        threads=threads,
    )
    with resumable():
        encoded = encode_drives(protocol_of(protocol, maps, queries, exclusion_s), methods or DEFAULT_METHODS, options)
    for method in encoded:
        typer.echo(f'{method.method}: {method.scans} scans of {method.drives} drives encoded, {method.refused} refused')
    typer.echo(f'{cache}: ready for offradar evaluate --cache {cache}')
