"""`offradar confidence`: coefficients of the probability that an answer is right, from the drives of a protocol."""

from pathlib import Path
from typing import Annotated

import typer

from offradar_ros.cli.interrupt import resumable
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import QueryConfig, load_config
from offradar_ros.lab.cli.evaluation_options import Params, Processes, Streets, Threads, print_note
from offradar_ros.lab.evaluation.confidence import fit, fit_alignments, write_confidence
from offradar_ros.lab.evaluation.evaluate import Options
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.records import require_writable

QUERIES = 24
"""Scans of each drive that are aligned with places of each map."""


def confidence(
    out: Annotated[Path, typer.Option(help='YAML file for the coefficients, as in params/confidence.')],
    protocol: Annotated[
        str, typer.Argument(help='Protocol: a YAML file, or the name of one that ships; none that results are of.')
    ] = 'confidence',
    method: Annotated[
        str, typer.Option(metavar='NAME[=WEIGHTS]', help='The encoder, as --method of offradar evaluate.')
    ] = 'ours=compact',
    cache: Annotated[Path, typer.Option(help='Folder of simulated scans and embeddings, as for evaluate.')] = (
        Path('evaluation') / 'cache'
    ),
    params: Params = None,
    streets: Streets = None,
    processes: Processes = 0,
    threads: Threads = 0,
) -> None:
    """Fit the probability that an answer is right, on maps of which half of the road is left out."""
    require_writable(out)
    options = Options(
        out=cache,
        cache=cache,
        command='',
        bar=progress_bar,
        note=print_note,
        streets=streets,
        encoder=load_config(params).encoder,
        processes=processes,
        threads=threads,
    )
    with resumable():
        read = read_protocol(protocol)
        found = fit(read, method, options)
        found = fit_alignments(read, method, options, found, places=QueryConfig().verify_candidates, queries=QUERIES)
    write_confidence(out, found, f'For {method}, fitted to the protocol {protocol} by offradar confidence.')
    typer.echo(f'{out}: written, for model {found.model[:12]}')
