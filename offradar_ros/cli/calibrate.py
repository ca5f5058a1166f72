"""`offradar calibrate`: parameters that make U mean something on this sensor."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Optional

import numpy as np
import typer
from numpy.typing import NDArray

from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import open_source
from offradar_ros.config import Config, Value, load_config, parameters, write_parameters
from offradar_ros.datasets.sequence import RadarSequence
from offradar_ros.encoders.calibration import largest_deviation, run_uncertainties, variance_factor
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.types import PolarScan

SCALE = 'encoder.ring_key.variance_scale'


def calibrate(
    source: Annotated[Path, typer.Argument(help='Bag or data-set folder of an ordinary drive.')],
    out: Annotated[Path, typer.Option(help='Parameter file to write.')],
    params: Annotated[Optional[Path], typer.Option(help='Parameter file with the encoder to calibrate.')] = None,
    layout: Annotated[str, typer.Option(help='Layout of the folder; auto recognises it.')] = 'auto',
) -> None:
    """Scale the ring key's variance so that U is 1 on average, and set Δ to the drive's largest |U − 1|."""
    config = load_config(params)
    sequence = open_source(source, layout, config.radar)
    values, uncertainties = calibrated(sequence, config)
    comment = f'Written by offradar calibrate over {len(uncertainties)} scans of {sequence.name}.'
    write_parameters(out, values, comment)
    typer.echo(
        f'{len(uncertainties)} of {len(sequence)} scans: U {uncertainties.mean():.3f} on average, '
        f'{uncertainties.min():.3f} to {uncertainties.max():.3f}, standard deviation {uncertainties.std():.3f}; '
        f'delta {values["query.delta"]:.3f}'
    )
    typer.echo(f'{out}: written')


def calibrated(sequence: RadarSequence, config: Config) -> tuple[dict[str, Value], NDArray[np.float64]]:
    """Parameters for the encoder and the query, and the U of each scan with them.

    Scans that are refused are left out; DataError if all are. A learned encoder's variance has its scale from training
    (prior at 1): only Δ is set for it.
    """
    encoder = make_encoder(config.encoder)
    with progress_bar(f'encoding {sequence.name}') as progress:

        def scans() -> Iterator[PolarScan]:
            for index in range(len(sequence)):
                with contextlib.suppress(RefusedInput):
                    yield sequence.scan(index)
                progress(index + 1, len(sequence))

        uncertainties = run_uncertainties(encoder, scans())
    if not len(uncertainties):
        raise DataError(f'{sequence.name}: expected at least one scan that can be encoded, got none')
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
