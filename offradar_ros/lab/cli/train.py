"""`offradar train`: weights of a learned encoder."""

import math
import os
from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.cli.install_hints import pip_hint
from offradar_ros.cli.interrupt import held_interrupt
from offradar_ros.cli.progress import progress_bar
from offradar_ros.errors import ConfigError

DEVICES = ('auto', 'cpu', 'cuda')


def train(
    config: Annotated[Path, typer.Option(help='Training configuration, such as those of params/train.')],
    out: Annotated[Path, typer.Option(help='Folder for weights, checkpoint, logs and curves.')],
    resume: Annotated[bool, typer.Option('--resume', help="Continue from the folder's checkpoint.")] = False,
    minutes: Annotated[
        Optional[float], typer.Option(min=0.0, help='Stop with a checkpoint after this time; --resume continues later.')
    ] = None,
    device: Annotated[str, typer.Option(help=f'Where to compute: {", ".join(DEVICES)}.')] = 'auto',
    settings: Annotated[
        Optional[list[str]], typer.Option('--set', metavar='KEY=VALUE', help='Change a key of the configuration.')
    ] = None,
    cache: Annotated[
        Optional[Path], typer.Option(help='Folder of cached scans, which runs may share; OUT/cache if not given.')
    ] = None,
) -> None:
    """Train a network on simulated or recorded drives; several GPUs by torchrun."""
    if device not in DEVICES:
        raise ConfigError(f'--device: expected one of {", ".join(DEVICES)}, got {device!r}')
    try:
        from offradar_ros.lab.training.config_file import read_config  # noqa: PLC0415
        from offradar_ros.lab.training.recorded_drives import training_sequences  # noqa: PLC0415
        from offradar_ros.lab.training.run import RunOptions, run  # noqa: PLC0415
    except ModuleNotFoundError as error:
        if error.name not in ('torch', 'safetensors'):
            raise
        raise ConfigError(f'training needs the Python package {error.name}: {pip_hint("torch")}') from error

    read = read_config(config, settings or ())
    sequences = training_sequences(read.data)
    if sequences and sequences.missing and os.environ.get('RANK', '0') == '0':
        wanted = len(sequences.missing) + len(sequences.found)
        typer.echo(
            f'warning: {read.data.root}: {len(sequences.missing)} of {wanted} training sequences of split '
            f'{sequences.split.name} are missing: {", ".join(sequences.missing)}',
            err=True,
        )
    with held_interrupt() as check:
        options = RunOptions(cache or out / 'cache', resume, minutes, device, progress_bar, check)
        result = run(read, out, options)
    if os.environ.get('RANK', '0') != '0':
        return
    if not result.finished:
        typer.echo(f'{out}: stopped after {result.step} steps; --resume continues from there')
        return
    score = '' if math.isnan(result.score) else f', validation score {result.score:.3f}'
    typer.echo(f'{result.best}: written{score}')
