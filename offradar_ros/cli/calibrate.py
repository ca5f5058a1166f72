"""`offradar calibrate`: parameters that make U mean something on this sensor."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import open_source
from offradar_ros.config import EncoderConfig, Value, load_config, write_parameters
from offradar_ros.datasets.sequence import RadarSequence
from offradar_ros.encoders.calibration import largest_deviation, run_uncertainties, variance_factor
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.types import PolarScan


def calibrate(
    source: Annotated[Path, typer.Argument(help='Bag or data-set folder of an ordinary drive.')],
    out: Annotated[Path, typer.Option(help='Parameter file to write.')],
    params: Annotated[Path | None, typer.Option(help='Parameter file with the encoder to calibrate.')] = None,
    layout: Annotated[str, typer.Option(help='Layout of the folder; auto recognises it.')] = 'auto',
) -> None:
    """Scale the ring key's variance so that U is 1 on average, and set Δ to the drive's largest |U − 1|."""
    config = load_config(params)
    sequence = open_source(source, layout, config.radar)
    uncertainties = _uncertainties(sequence, config.encoder)
    factor = variance_factor(uncertainties) if config.encoder.name == 'ring_key' else 1.0
    uncertainties = uncertainties * factor
    delta = largest_deviation(uncertainties)
    values: dict[str, Value] = {'encoder.name': config.encoder.name}
    if config.encoder.name == 'ring_key':
        values |= {
            f'encoder.ring_key.{field.name}': getattr(config.encoder.ring_key, field.name)
            for field in dataclasses.fields(config.encoder.ring_key)
        }
        values['encoder.ring_key.variance_scale'] = config.encoder.ring_key.variance_scale * factor
    else:
        values['encoder.weights'] = config.encoder.weights
    values |= {'query.delta': delta, 'query.levels': config.query.levels, 'query.level': config.query.levels}
    write_parameters(out, values, f'Written by offradar calibrate over {len(uncertainties)} scans of {sequence.name}.')
    typer.echo(
        f'{len(uncertainties)} scans: U {uncertainties.mean():.3f} on average, {uncertainties.min():.3f} to '
        f'{uncertainties.max():.3f}, standard deviation {uncertainties.std():.3f}; delta {delta:.3f}'
    )
    typer.echo(f'{out}: written')


def _uncertainties(sequence: RadarSequence, config: EncoderConfig) -> NDArray[np.float64]:
    encoder = make_encoder(config)
    with progress_bar(f'encoding {sequence.name}') as progress:

        def scans() -> Iterator[PolarScan]:
            for index in range(len(sequence)):
                yield sequence.scan(index)
                progress(index + 1, len(sequence))

        return run_uncertainties(encoder, scans())
