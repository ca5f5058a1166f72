"""`offradar export`: trained weights as the vehicle wants them."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.cli.need import pip_hint
from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import LAYOUT_HELP, open_source
from offradar_ros.config import RadarConfig
from offradar_ros.encoders.model_files import require_file
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ConfigError, OffradarError

SAFETENSORS = '.safetensors'


def export(
    weights: Annotated[Path, typer.Argument(help='Weights of a learned encoder (.safetensors).')],
    out: Annotated[Path, typer.Argument(help='File to write: ONNX, unless it ends in .safetensors.')],
    half: Annotated[bool, typer.Option('--half', help='Store .safetensors in half precision.')] = False,
    unit_u: Annotated[
        Optional[Path],
        typer.Option(help='Clean drive, a bag or folder: scale the variance so that its U is 1 on average.'),
    ] = None,
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
) -> None:
    """Export a learned encoder to ONNX, which needs no torch, or to safetensors in half precision, its U set to 1.

    An ONNX file holds the very model of its safetensors, down to the fingerprint.
    """
    require_file(weights)
    to_onnx = out.suffix != SAFETENSORS
    if to_onnx and (half or unit_u):
        raise ConfigError(f'{out}: --half and --unit-u are for .safetensors: export that to .onnx afterwards')
    try:
        header = _to_onnx(weights, out) if to_onnx else _to_safetensors(weights, out, half, unit_u, layout)
    except ImportError as error:
        raise OffradarError(f'export needs torch and onnx: {pip_hint("torch")} ({error})') from error
    typer.echo(f'{out}: {header.fingerprint}')


def _to_onnx(weights: Path, out: Path) -> WeightsHeader:
    from offradar_ros.encoders.onnx_export import export_onnx  # noqa: PLC0415

    return export_onnx(weights, out)


def _to_safetensors(weights: Path, out: Path, half: bool, unit_u: Optional[Path], layout: str) -> WeightsHeader:
    from offradar_ros.encoders.shipping import ship  # noqa: PLC0415

    if unit_u is None:
        return ship(weights, out, half=half, clean_drive=None)
    drive = open_source(unit_u, layout, RadarConfig())
    with progress_bar(f'encoding {drive.name}') as progress:
        return ship(weights, out, half=half, clean_drive=drive, progress=progress)
