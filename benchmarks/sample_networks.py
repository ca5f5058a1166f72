"""Networks for timings, in files that are made once: random weights take as long as trained ones."""

from __future__ import annotations

from pathlib import Path

from drives import offradar

from offradar_ros.encoders.network_config import NetworkConfig

SEED = 1


def random_weights(folder: Path, name: str, config: NetworkConfig) -> Path:
    """A weights file for the network of `config`, with random weights."""
    weights = folder / f'{name}.safetensors'
    if not weights.is_file():
        import torch  # noqa: PLC0415

        from offradar_ros.encoders.networks.files import save_network  # noqa: PLC0415
        from offradar_ros.encoders.networks.registry import make_network  # noqa: PLC0415

        torch.manual_seed(SEED)
        save_network(weights, make_network(config), 'weights drawn at random, for timing only')
    return weights


def exported(weights: Path, folder: Path) -> Path:
    """An ONNX file made from a weights file."""
    path = folder / f'{_named(weights, folder)}.onnx'
    if not path.is_file():
        offradar('export', weights, path)
    return path


def quantised(weights: Path, folder: Path, drive: Path) -> Path:
    """An ONNX file in 8-bit integers made from a weights file, calibrated on a drive."""
    path = folder / f'{_named(weights, folder)}_int8.onnx'
    if not path.is_file():
        offradar('export', weights, path, '--int8', '--calibrate', drive)
    return path


def _named(weights: Path, folder: Path) -> str:
    """A name with the folder in it: the weights of all training runs have the same file name."""
    inside = weights.parent.resolve() == folder.resolve()
    return weights.stem if inside else f'{weights.resolve().parent.name}_{weights.stem}'
