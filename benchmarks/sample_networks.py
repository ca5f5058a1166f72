"""Networks to time, in files that are made once: weights drawn at random take as long as learnt ones."""

from __future__ import annotations

from pathlib import Path

from drives import offradar

from offradar_ros.encoders.network_config import NetworkConfig

SEED = 1


def drawn(folder: Path, name: str, config: NetworkConfig) -> Path:
    """Weights of the network of `config`, drawn at random."""
    weights = folder / f'{name}.safetensors'
    if not weights.is_file():
        import torch  # noqa: PLC0415

        from offradar_ros.encoders.networks.files import save_network  # noqa: PLC0415
        from offradar_ros.encoders.networks.registry import make_network  # noqa: PLC0415

        torch.manual_seed(SEED)
        save_network(weights, make_network(config), 'weights drawn at random, for timing only')
    return weights


def exported(weights: Path, folder: Path) -> Path:
    """A weights file as ONNX."""
    path = folder / f'{_named(weights, folder)}.onnx'
    if not path.is_file():
        offradar('export', weights, path)
    return path


def in_integers(weights: Path, folder: Path, drive: Path) -> Path:
    """A weights file as ONNX in integers, calibrated on a drive."""
    path = folder / f'{_named(weights, folder)}_int8.onnx'
    if not path.is_file():
        offradar('export', weights, path, '--int8', '--calibrate', drive)
    return path


def _named(weights: Path, folder: Path) -> str:
    """Runs of training all call their weights alike: the folder tells them apart."""
    inside = weights.parent.resolve() == folder.resolve()
    return weights.stem if inside else f'{weights.resolve().parent.name}_{weights.stem}'
