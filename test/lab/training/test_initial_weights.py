"""A network that starts from another's weights gives the same for maps that cover the same ground."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip('torch')

from offradar_ros.encoders.network_config import NetworkConfig  # noqa: E402
from offradar_ros.encoders.networks.files import save_network  # noqa: E402
from offradar_ros.encoders.networks.network import Network  # noqa: E402
from offradar_ros.encoders.networks.registry import make_network  # noqa: E402
from offradar_ros.errors import ModelError  # noqa: E402
from offradar_ros.lab.training.initial_weights import start_from  # noqa: E402

SMALL = NetworkConfig(backbone='vgg16', dimension=6, side_px=128, resolution_m=2.0)
"""Feature map of 4 × 4 cells of 64 m."""
LARGE = dataclasses.replace(SMALL, side_px=256, resolution_m=1.0)
POLAR = NetworkConfig(backbone='compact', dimension=6, azimuths=32, range_bins=64, resolution_m=2.0)


def network_of(config: NetworkConfig, seed: int) -> Any:
    torch.manual_seed(seed)
    return make_network(config).eval()


def started(config: NetworkConfig, source: Network, folder: Path) -> Any:
    save_network(folder / 'first.safetensors', source)
    network = network_of(config, 2)
    start_from(network, folder / 'first.safetensors')
    return network


def outputs(network: Any, features: Any) -> tuple[Any, Any, Any]:
    flat = features.flatten(1)
    with torch.no_grad():
        return network.z_i(flat), network.mu(flat), network.log_variance_of(flat)


def smooth(rows: int, columns: int, half_m: float) -> Any:
    """(2, 512, rows, columns): maps that vary over hundreds of metres, at the centres of cells."""
    generator = torch.Generator().manual_seed(5)
    y, x = (half_m * (2.0 * (torch.arange(n) + 0.5) / n - 1.0) for n in (rows, columns))
    waves = torch.rand(2, 512, 3, generator=generator) * 2.0 - 1.0
    phase = (waves[..., 0, None, None] * y[:, None] + waves[..., 1, None, None] * x) / 200.0
    return 1.0 + torch.sin(phase + 3.0 * waves[..., 2, None, None])


def test_the_output_for_a_map_that_is_constant_within_each_old_cell_is_the_same(tmp_path: Path) -> None:
    source = network_of(SMALL, 1)
    network = started(LARGE, source, tmp_path)
    maps = torch.rand(2, 512, 4, 4)
    fine = maps.repeat_interleave(2, dim=2).repeat_interleave(2, dim=3)
    for found, expected in zip(outputs(network, fine), outputs(source, maps), strict=True):
        assert torch.allclose(found, expected, rtol=1e-4, atol=1e-5)
    # The decoder's first layer gives each new cell what it gave the old one.
    z = torch.rand(2, 6)
    old = source.decoder[:3](z).repeat_interleave(2, dim=2).repeat_interleave(2, dim=3)
    assert torch.allclose(network.decoder[:3](z), old, rtol=1e-4, atol=1e-5)
    for name, tensor in network.features.state_dict().items():
        assert torch.equal(tensor, source.features.state_dict()[name])


@pytest.mark.parametrize(('side_px', 'most'), [(256, 0.01), (192, 0.05), (64, 0.2)])
def test_the_output_for_a_smooth_map_is_close(tmp_path: Path, side_px: int, most: float) -> None:
    source = network_of(SMALL, 1)
    network = started(dataclasses.replace(SMALL, side_px=side_px, resolution_m=256.0 / side_px), source, tmp_path)
    cells = side_px // 32
    for found, expected in zip(
        outputs(network, smooth(cells, cells, 128.0)), outputs(source, smooth(4, 4, 128.0)), strict=True
    ):
        assert float((found - expected).norm() / expected.norm()) < most


def test_weights_against_a_loop_over_cells(tmp_path: Path) -> None:
    source = network_of(SMALL, 1)
    network = started(dataclasses.replace(SMALL, side_px=192, resolution_m=256.0 / 192), source, tmp_path)
    old = source.z_i.weight.detach().reshape(6, 512, 4, 4)[:, :20].numpy()
    new = network.z_i.weight.detach().reshape(6, 512, 6, 6)[:, :20].numpy()
    expected = np.zeros_like(new)
    for row in range(6):
        for column in range(6):
            for i in range(4):
                for j in range(4):
                    # Six cells of 2/3 of an old one.
                    tall = max(0.0, min((row + 1) * 2 / 3, i + 1) - max(row * 2 / 3, i))
                    wide = max(0.0, min((column + 1) * 2 / 3, j + 1) - max(column * 2 / 3, j))
                    expected[:, :, row, column] += tall * wide * old[:, :, i, j]
    assert new == pytest.approx(expected, abs=1e-6)


def test_a_wider_field_of_view_keeps_the_weights_in_its_middle(tmp_path: Path) -> None:
    source = network_of(SMALL, 1)
    network = started(dataclasses.replace(LARGE, resolution_m=2.0), source, tmp_path)
    wide = torch.zeros(2, 512, 8, 8)
    wide[:, :, 2:6, 2:6] = maps = torch.rand(2, 512, 4, 4)
    for found, expected in zip(outputs(network, wide), outputs(source, maps), strict=True):
        assert torch.allclose(found, expected, rtol=1e-4, atol=1e-5)


def test_a_longer_polar_image_keeps_the_weights_of_what_is_near(tmp_path: Path) -> None:
    source = network_of(POLAR, 1)
    network = started(dataclasses.replace(POLAR, range_bins=96), source, tmp_path)
    long = torch.zeros(2, 48, source.features.shape[1], 12)
    long[..., :8] = maps = torch.rand(2, *source.features.shape)
    for found, expected in zip(outputs(network, long), outputs(source, maps), strict=True):
        assert torch.allclose(found, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize('method', ['variational', 'bc_radar', 'vae', 'mc_dropout', 'stun'])
@pytest.mark.parametrize('backbone', ['vgg16', 'compact'])
def test_an_equal_network_starts_with_equal_weights(tmp_path: Path, method: str, backbone: str) -> None:
    config = NetworkConfig(method=method, backbone=backbone, dimension=6, side_px=64, azimuths=32, range_bins=32)
    source = network_of(config, 1)
    network = started(config, source, tmp_path)
    given = source.state_dict()
    assert all(torch.equal(tensor, given[name]) for name, tensor in network.state_dict().items())


def test_other_methods_are_carried_over_but_for_a_decoder_of_the_image(tmp_path: Path) -> None:
    for method in ('bc_radar', 'mc_dropout', 'stun'):
        source = network_of(dataclasses.replace(SMALL, method=method), 1)
        network = started(dataclasses.replace(LARGE, method=method), source, tmp_path)
        maps = torch.rand(2, 512, 4, 4)
        fine = maps.repeat_interleave(2, dim=2).repeat_interleave(2, dim=3)
        assert torch.allclose(network.head(fine.flatten(1)), source.head(maps.flatten(1)), rtol=1e-4, atol=1e-5)
    auto_encoder = network_of(dataclasses.replace(SMALL, method='vae'), 1)
    with pytest.raises(ModelError, match=r'tensor decoder\.0\.weight depends on the size of the image'):
        started(dataclasses.replace(LARGE, method='vae'), auto_encoder, tmp_path)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'dimension': 8}, 'initial weights with dimension = 8, got 6'),
        ({'backbone': 'compact'}, 'initial weights with backbone = compact, got vgg16'),
        ({'method': 'bc_radar'}, 'initial weights with method = bc_radar, got variational'),
    ],
)
def test_weights_of_another_network_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        started(dataclasses.replace(SMALL, **changes), network_of(SMALL, 1), tmp_path)
