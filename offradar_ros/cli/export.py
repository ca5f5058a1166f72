"""`offradar export`: trained weights as the vehicle wants them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import numpy as np
import typer

from offradar_ros.cli.need import pip_hint
from offradar_ros.cli.progress import progress_bar
from offradar_ros.cli.source import LAYOUT_HELP, open_source
from offradar_ros.config import RadarConfig
from offradar_ros.encoders.calibration import variance_factor
from offradar_ros.encoders.model_files import require_file
from offradar_ros.errors import ConfigError, OffradarError

if TYPE_CHECKING:
    from offradar_ros.encoders.weights_header import WeightsHeader

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


def _to_onnx(weights: Path, out: Path) -> 'WeightsHeader':
    from offradar_ros.encoders.onnx_export import export_onnx  # noqa: PLC0415

    return export_onnx(weights, out)


def _to_safetensors(weights: Path, out: Path, half: bool, unit_u: Optional[Path], layout: str) -> 'WeightsHeader':
    from offradar_ros.encoders.encode import encode_all  # noqa: PLC0415
    from offradar_ros.encoders.network_files import load_network, save_network  # noqa: PLC0415
    from offradar_ros.encoders.torch_backend import TorchEncoder  # noqa: PLC0415
    from offradar_ros.encoders.variational import VariationalNetwork  # noqa: PLC0415

    network, header = load_network(weights)
    description = header.description
    if unit_u is not None:
        if not isinstance(network, VariationalNetwork):
            raise ConfigError(f'{weights}: --unit-u is for the variational method, got {header.config.method}')
        drive = open_source(unit_u, layout, RadarConfig())
        with progress_bar(f'encoding {drive.name}') as progress:
            _, variances = encode_all(TorchEncoder(str(weights), 0), drive, progress)
        factor = variance_factor(np.nanmean(variances, axis=1))
        network.scale_variance(factor)
        description = f'{description}; variance × {factor:.6g}, for U = 1 over {len(drive)} scans of {drive.name}'
    return save_network(out, network, description, half)
