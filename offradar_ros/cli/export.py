"""`offradar export`: trained weights in the formats that a vehicle uses."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.cli.install_hints import pip_hint
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import RadarConfig
from offradar_ros.encoders.export.calibration_scans import SCANS, calibration_scans
from offradar_ros.encoders.export.onnx_export import Compression, export_onnx
from offradar_ros.encoders.export.onnx_probe import add_digest
from offradar_ros.encoders.model_files import require_file, require_package
from offradar_ros.encoders.pretrained import find_weights, pretrained_names
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ConfigError, OffradarError
from offradar_ros.recordings.source import LAYOUT_HELP, open_source

SAFETENSORS, ONNX = '.safetensors', '.onnx'


def export(
    weights: Annotated[
        Path, typer.Argument(help='Weights of a learned encoder (.safetensors), or the name of ours that come with us.')
    ],
    out: Annotated[Path, typer.Argument(help='File to write: ONNX, unless it ends in .safetensors.')],
    half: Annotated[bool, typer.Option('--half', help='Store .safetensors in half precision.')] = False,
    unit_u: Annotated[
        Optional[Path],
        typer.Option(help='Clean drive, a bag or folder: scale the variance so that its U is 1 on average.'),
    ] = None,
    int8: Annotated[bool, typer.Option('--int8', help='ONNX that computes with 8-bit integers.')] = False,
    low_rank: Annotated[
        float,
        typer.Option(min=0.05, max=1.0, help="ONNX that keeps this share of the convolutions' multiplications."),
    ] = 1.0,
    calibrate: Annotated[
        Optional[list[Path]],
        typer.Option(help='Drive that --int8 and --low-rank are fitted to, a bag or folder; may be repeated.'),
    ] = None,
    scans: Annotated[
        int, typer.Option(min=1, max=10_000, help='Scans of those drives, spread evenly over them.')
    ] = SCANS,
    layout: Annotated[str, typer.Option(help=LAYOUT_HELP)] = 'auto',
) -> None:
    """Export a learned encoder to ONNX, which needs no torch, or to safetensors in half precision, its U set to 1.

    An ONNX file holds the same model as its safetensors, with the same fingerprint. With --int8 or --low-rank it is
    another, faster model: its embeddings compare only with its own, and its thresholds must be calibrated again.
    An ONNX file of an earlier version, without a digest, is copied with one: only if you trust what it holds.
    """
    if str(weights) in pretrained_names():
        weights = find_weights(str(weights), (SAFETENSORS,))
    require_file(weights)
    if weights.suffix == ONNX:
        if out.suffix == SAFETENSORS or half or unit_u or int8 or low_rank < 1.0 or calibrate:
            raise ConfigError(f'{weights}: options are for .safetensors: an ONNX file only gets its digest, as ONNX')
        header = add_digest(weights, out)
        typer.echo(f'{out}: {header.fingerprint}, now with a digest of what {weights} holds')
        return
    to_onnx, compressed = out.suffix != SAFETENSORS, int8 or low_rank < 1.0
    if to_onnx and (half or unit_u):
        raise ConfigError(f'{out}: --half and --unit-u are for .safetensors: export that to .onnx afterwards')
    if compressed and not to_onnx:
        raise ConfigError(f'{out}: --int8 and --low-rank are for .onnx')
    if compressed and not calibrate:
        raise ConfigError(f'{out}: --int8 and --low-rank are fitted to drives: expected --calibrate DRIVE')
    if calibrate and not compressed:
        raise ConfigError(f'{out}: --calibrate is for --int8 and --low-rank: expected one of them, --low-rank below 1')
    try:
        if to_onnx:
            header = export_onnx(weights, out, _compression(weights, int8, low_rank, calibrate or [], scans, layout))
        else:
            header = _to_safetensors(weights, out, half, unit_u, layout)
    except ImportError as error:
        raise OffradarError(f'export needs torch and onnx: {pip_hint("torch")} ({error})') from error
    typer.echo(f'{out}: {header.fingerprint}')


def _compression(
    weights: Path,
    int8: bool,
    low_rank: float,
    calibrate: list[Path],
    scans: int,
    layout: str,
) -> Optional[Compression]:
    if not calibrate:
        return None
    require_package('safetensors', weights)
    from offradar_ros.encoders.weights import read_header  # noqa: PLC0415

    config = read_header(weights).config
    drives = [open_source(path, layout, RadarConfig()) for path in calibrate]
    return Compression(calibration_scans(drives, config, scans), int8=int8, low_rank=low_rank)


def _to_safetensors(weights: Path, out: Path, half: bool, unit_u: Optional[Path], layout: str) -> WeightsHeader:
    from offradar_ros.calibration.shipping import ship  # noqa: PLC0415

    if unit_u is None:
        return ship(weights, out, half=half, clean_drive=None)
    drive = open_source(unit_u, layout, RadarConfig())
    with progress_bar(f'encoding {drive.name}') as progress:
        return ship(weights, out, half=half, clean_drive=drive, progress=progress)
