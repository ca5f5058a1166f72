"""Synthetic scans, and small networks with random weights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.types import PolarScan

SMALL = NetworkConfig(backbone='compact_centred', dimension=8, azimuths=64, range_bins=32, resolution_m=2.0)


@pytest.fixture
def small_config() -> NetworkConfig:
    return SMALL


def make_scan(power: np.ndarray, range_resolution_m: float = 0.5, range_offset_m: float = 0.0) -> PolarScan:
    azimuths = np.linspace(0.0, 2 * np.pi, len(power), endpoint=False)
    return PolarScan(1_000_000_007, power, azimuths, range_resolution_m, range_offset_m)


@pytest.fixture
def street() -> PolarScan:
    """A scan with structure: walls at a range that changes with azimuth, poles, and a low noise floor."""
    rng = np.random.default_rng(7)
    power = rng.integers(0, 12, (400, 300)).astype(np.uint8)
    turns = np.arange(400) / 400
    wall = (60 + 40 * np.sin(2 * np.pi * turns) ** 2 + 15 * np.cos(14 * np.pi * turns)).astype(int)
    for row, at in enumerate(wall):
        power[row, at : at + 4] = 120
    for row, at in rng.integers((0, 10), (400, 280), (60, 2)):
        power[row : row + 3, at : at + 2] = 160
    return make_scan(power)


@pytest.fixture(scope='session')
def save_random(tmp_path_factory: pytest.TempPathFactory) -> Callable[[NetworkConfig], Path]:
    """Writes random weights whose variances differ between scans, as in trained ones; returns their file."""
    torch = pytest.importorskip('torch')
    from offradar_ros.encoders.networks.files import save_network  # noqa: PLC0415
    from offradar_ros.encoders.networks.variational import VariationalNetwork  # noqa: PLC0415

    def save(config: NetworkConfig) -> Path:
        torch.manual_seed(3)
        network = VariationalNetwork(config)
        with torch.no_grad():
            images = torch.randint(0, 256, (1, *config.image_shape), dtype=torch.uint8)
            flat = network.eval().features(images).flatten(1)
            # Log variances of about ±1 for every backbone: at the clamp all runtimes would agree.
            network.log_variance.weight.normal_(std=1.0 / float(flat.norm()))
        path = tmp_path_factory.mktemp('weights') / f'{config.backbone}.safetensors'
        save_network(path, network, 'random weights of a test')
        return path

    return save


@pytest.fixture(scope='session')
def small_weights(save_random: Callable[[NetworkConfig], Path]) -> Path:
    return save_random(SMALL)


@pytest.fixture(scope='session')
def small_onnx(small_weights: Path) -> Path:
    pytest.importorskip('onnx')
    from offradar_ros.encoders.export.onnx_export import export_onnx  # noqa: PLC0415

    path = small_weights.with_suffix('.onnx')
    export_onnx(small_weights, path)
    return path
