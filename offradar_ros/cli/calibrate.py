"""`offradar calibrate`: parameters that make U mean something on this sensor."""

from pathlib import Path
from typing import Annotated, Any, Optional

import numpy as np
import typer
from numpy.typing import NDArray

from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import LAYOUT_HELP, open_source
from offradar_ros.config import (
    Config,
    Value,
    load_config,
    parameters,
    read_parameters,
    require_writable,
    write_parameters,
)
from offradar_ros.datasets.sequence import RadarSequence
from offradar_ros.encoders.calibration import largest_deviation, variance_factor
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError, RefusedInput

SCALE = 'encoder.ring_key.variance_scale'
FEWEST_SCANS = 2
ENOUGH_SCANS = 100
"""Below this the largest |U − 1| of a drive is a poor estimate of that of other drives."""


def calibrate(
    source: Annotated[Path, typer.Argument(help='Bag or data-set folder of an ordinary drive.')],
    out: Annotated[Path, typer.Option(help='Parameter file to write; it may be the one given with --params.')],
    params: Annotated[
        Optional[Path], typer.Option(help='Parameter file with the encoder to calibrate; the rest of it is kept.')
    ] = None,
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
) -> None:
    """Scale the ring key's variance so that U is 1 on average, and set Δ to the drive's largest |U − 1|."""
    config = load_config(params)
    sequence = open_source(source, layout, config.radar)
    existed = out.exists()
    require_writable(out)
    values, uncertainties = calibrated(sequence, config)
    comment = f'Written by offradar calibrate over {len(uncertainties)} scans of {sequence.name}.'
    write_parameters(out, _given(params, config) | values, comment)
    typer.echo(
        f'{len(uncertainties)} of {len(sequence)} scans: U {uncertainties.mean():.3f} on average, '
        f'{uncertainties.min():.3f} to {uncertainties.max():.3f}, standard deviation {uncertainties.std():.3f}; '
        f'delta {values["query.delta"]:.3f}'
    )
    if len(uncertainties) < ENOUGH_SCANS:
        typer.echo(
            f'note: Δ from {len(uncertainties)} scans is too narrow and will reject ordinary drives: '
            f'calibrate over {ENOUGH_SCANS} scans or more'
        )
    typer.echo(f'{out}: {"replaced" if existed else "written"}')


def _given(params: Optional[Path], config: Config) -> dict[str, Any]:
    """Every parameter of the file, those for nodes alone included, each of the type that nodes want."""
    if params is None:
        return {}
    typed = {leaf.name: leaf.value for leaf in parameters(config)}
    return {name: typed.get(name, value) for name, value in read_parameters(params).items()}


def calibrated(sequence: RadarSequence, config: Config) -> tuple[dict[str, Value], NDArray[np.float64]]:
    """Parameters for the encoder and the query, and the U of each scan with them.

    Scans that are refused are left out; DataError if fewer than two are left. A learned encoder's variance has its
    scale from training (prior at 1): only Δ is set for it.
    """
    uncertainties = _uncertainties(sequence, config)
    values: dict[str, Value] = {
        leaf.name: leaf.value for leaf in parameters(config) if leaf.name.startswith('encoder.') and leaf.value != ''
    }
    if config.encoder.name == 'ring_key':
        factor = variance_factor(uncertainties)
        uncertainties = uncertainties * factor
        values[SCALE] = config.encoder.ring_key.variance_scale * factor
    delta = largest_deviation(uncertainties)
    values |= {'query.delta': delta, 'query.levels': config.query.levels, 'query.level': config.query.levels}
    return values, uncertainties


def _uncertainties(sequence: RadarSequence, config: Config) -> NDArray[np.float64]:
    encoder = make_encoder(config.encoder)
    found: list[float] = []
    refused: dict[str, list[str]] = {}
    with progress_bar(f'encoding {sequence.name}') as progress:
        for index in range(len(sequence)):
            try:
                found.append(encoder.encode(sequence.scan(index)).uncertainty)
            except RefusedInput as refusal:
                refused.setdefault(refusal.cause, []).append(str(refusal))
            progress(index + 1, len(sequence))
    if len(found) < FEWEST_SCANS:
        causes = [
            f'{len(said)} of {len(sequence)} scans refused: {cause}: {said[0]}' for cause, said in refused.items()
        ]
        raise DataError(
            f'{sequence.name}: expected at least {FEWEST_SCANS} scans that can be encoded, got {len(found)}'
            + ''.join(f'; {cause}' for cause in causes)
        )
    return np.array(found, np.float64)
