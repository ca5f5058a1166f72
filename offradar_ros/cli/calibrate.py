"""`offradar calibrate`: the probability of an answer, the gate on it and the threshold on U, for a sensor."""

import dataclasses
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from offradar_ros.calibration.error_control import LEAST_CONFIDENCE, ErrorLimit
from offradar_ros.calibration.gate_choice import GateChoice
from offradar_ros.calibration.gate_picture import draw_gate
from offradar_ros.calibration.one_drive import calibrate_drive
from offradar_ros.calibration.parameters import Calibration
from offradar_ros.calibration.reliability import draw_reliability
from offradar_ros.calibration.road import calibrate_road
from offradar_ros.calibration.threshold_choice import ThresholdChoice
from offradar_ros.cli.bag_topics import Positions, Topic
from offradar_ros.cli.install_hints import pip_hint
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import (
    Config,
    load_config,
    parameters,
    read_parameters,
    write_parameters,
)
from offradar_ros.errors import ConfigError
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.road import open_road
from offradar_ros.recordings.source import LAYOUT_HELP, open_source
from offradar_ros.recordings.spacing import MAP_SPACING_M
from offradar_ros.records import require_writable

LEVELS = 20
REJECT_AT_MOST, ERROR_RATE, OFF_MAP_RATE, CONFIDENCE = 0.01, 0.05, 0.01, 0.95
"""Defaults of --reject-at-most, --error-rate, --off-map-rate and --confidence."""


def calibrate(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar='SOURCE',
            help='Bag or data-set folder of an ordinary drive; or several, with positions, of one road.',
        ),
    ],
    out: Annotated[Path, typer.Option(help='Parameter file to write; it may be the one given with --params.')],
    params: Annotated[
        Optional[Path], typer.Option(help='Parameter file with the encoder to calibrate; the rest of it is kept.')
    ] = None,
    reject_at_most: Annotated[
        Optional[float],
        typer.Option(
            min=0.0001,
            max=0.5,
            help=f'One drive: share of ordinary scans that may be rejected; {REJECT_AT_MOST:g} if not given.',
        ),
    ] = None,
    error_rate: Annotated[
        Optional[float],
        typer.Option(
            min=0.001,
            max=0.5,
            help=f'Several drives: share of the answers that may be wrong; {ERROR_RATE:g} if not given.',
        ),
    ] = None,
    off_map_rate: Annotated[
        Optional[float],
        typer.Option(
            min=0.001,
            max=0.5,
            help=f'Several drives: share of the scans off the map that may be answered; {OFF_MAP_RATE:g} if not given.',
        ),
    ] = None,
    confidence: Annotated[
        Optional[float],
        typer.Option(
            min=LEAST_CONFIDENCE,
            max=0.9999,
            help=f'Several drives: confidence that both are kept; {CONFIDENCE:g} if not given.',
        ),
    ] = None,
    spacing_m: Annotated[
        float, typer.Option(min=0.0, help='Several drives: metres driven between two scans that are used; 0: all.')
    ] = MAP_SPACING_M,
    levels: Annotated[
        Optional[int],
        typer.Option(
            min=1, max=10000, help=f'N, steps between the thresholds; that of --params, or {LEVELS}, if not given.'
        ),
    ] = None,
    plot: Annotated[
        Optional[Path],
        typer.Option(help='Several drives: picture of how reliable the probability is (needs matplotlib).'),
    ] = None,
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
    topic: Topic = '',
    positions: Positions = '',
) -> None:
    """Fit the probability that an answer is right to a sensor, and choose the gate on it and the threshold on U.

    Over one drive: shipped coefficients are shifted to the sensor. Over several: they are learned from stretches left
    out of the map, and few answers are wrong, on the map and off it. docs/calibration.md says what is certain of
    either.
    """
    one = {'--reject-at-most': reject_at_most}
    several = {'--error-rate': error_rate, '--off-map-rate': off_map_rate, '--confidence': confidence}
    unfit = [name for name, value in (several if len(sources) == 1 else one).items() if value is not None]
    if unfit:
        raise ConfigError(f'{unfit[0]}: expected {"several drives" if len(sources) == 1 else "one drive"} for it')
    if plot is not None and len(sources) == 1:
        raise ConfigError('--plot: one drive has no wrong answers to draw: expected several of one road')
    if plot is not None and importlib.util.find_spec('matplotlib') is None:
        raise ConfigError(f'--plot needs the Python package matplotlib: {pip_hint("plot")}')
    given = {} if params is None else read_parameters(params)
    config = _with_levels(load_config(params), levels or given.get('query.levels', LEVELS))
    if off_map_rate is not None and config.query.gate == 'paper':
        raise ConfigError('--off-map-rate: expected query.gate: probability for it: U knows nothing of the map')
    replaced = {path: path.exists() for path in (plot, out) if path is not None}
    topics = ChosenTopics(topic, positions)
    if len(sources) == 1:
        sequence = open_source(sources[0], layout, config.radar, topics)
        require_writable(out)
        with progress_bar(f'encoding {sequence.name}') as progress:
            calibration = calibrate_drive(sequence, config, reject_at_most or REJECT_AT_MOST, progress)
    else:
        require_writable(out)
        if plot is not None:
            require_writable(plot, like=None)
        limit = ErrorLimit(error_rate or ERROR_RATE, confidence or CONFIDENCE, off_map_rate or OFF_MAP_RATE)
        calibration, choice = _over_road(sources, layout, topics, config, limit, spacing_m)
        if isinstance(choice, GateChoice) and plot is not None:
            draw_gate(choice, plot)
        elif isinstance(choice, ThresholdChoice) and plot is not None:
            draw_reliability(choice, plot)
    values = _typed(given, config) | calibration.values
    write_parameters(out, values, f'Written by offradar calibrate over {calibration.source}.', with_digest=True)
    written = [f'{path}: {"replaced" if existed else "written"}' for path, existed in replaced.items()]
    for line in (*calibration.lines, *written):
        typer.echo(line)


def _over_road(
    sources: Sequence[Path], layout: str, topics: ChosenTopics, config: Config, limit: ErrorLimit, spacing_m: float
) -> tuple[Calibration, GateChoice | ThresholdChoice]:
    paths = [path.resolve() for path in sources]
    if len(set(paths)) < len(paths):
        raise ConfigError(f'{", ".join(map(str, sources))}: expected each folder once')
    road = open_road(paths, layout, config.radar, config.position, name='calibration', topics=topics)
    drives = [drive.subsampled(spacing_m) for drive in road.drives]
    with progress_bar(f'encoding {", ".join(drive.name for drive in drives)}') as progress:
        calibration, choice = calibrate_road(drives, config, limit, progress)
    notes = tuple(f'note: {note}' for note in road.notes)
    return dataclasses.replace(calibration, lines=calibration.lines + notes), choice


def _with_levels(config: Config, levels: int) -> Config:
    # Set together: the level of the file may be above the new N.
    return dataclasses.replace(config, query=dataclasses.replace(config.query, levels=levels, level=levels))


def _typed(given: dict[str, Any], config: Config) -> dict[str, Any]:
    """Every parameter of the file, also those of the nodes alone, each with the type that the nodes expect."""
    typed = {leaf.name: leaf.value for leaf in parameters(config)}
    return {name: typed.get(name, value) for name, value in given.items()}
