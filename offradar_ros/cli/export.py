"""`offradar export`: trained weights to ONNX, which the vehicle runs without torch."""

from pathlib import Path
from typing import Annotated

import typer

from offradar_ros.cli.need import pip_hint
from offradar_ros.encoders.model_files import require_file
from offradar_ros.errors import OffradarError


def export(
    weights: Annotated[Path, typer.Argument(help='Weights of a learned encoder (.safetensors).')],
    out: Annotated[Path, typer.Argument(help='ONNX file to write.')],
) -> None:
    """Export a learned encoder to ONNX, checked against the weights' fingerprint."""
    require_file(weights)
    try:
        from offradar_ros.encoders.onnx_export import export_onnx  # noqa: PLC0415
    except ImportError as error:
        raise OffradarError(f'export needs torch and onnx: {pip_hint("torch")} ({error})') from error
    header = export_onnx(weights, out)
    typer.echo(f'{out}: {header.fingerprint}')
