"""Low-rank convolutions: exact for responses of low rank, and within the share of multiplications."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from radar_images import speckle

pytest.importorskip('torch')

import torch

from offradar_ros.encoders.export.calibration_scans import CalibrationScans
from offradar_ros.encoders.export.onnx_export import Compression, export_onnx
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.backbone import Vgg16
from offradar_ros.encoders.networks.low_rank import factorise
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.encoders.onnx_backend import OnnxEncoder

VGG16 = NetworkConfig(method='bc_radar', dimension=8, side_px=32)
COMPACT = NetworkConfig(method='bc_radar', backbone='compact', dimension=8, azimuths=64, range_bins=32)


def network_of(config: NetworkConfig, seed: int = 3) -> Network:
    torch.manual_seed(seed)
    return make_network(config).eval()


def vgg16_layers(network: Network) -> torch.nn.Sequential:
    backbone = network.features.backbone
    assert isinstance(backbone, Vgg16)
    return backbone.features


def multiplications(network: Network, config: NetworkConfig) -> int:
    """Multiplications of all convolutions for one image, counted in the forward pass."""
    counts: list[int] = []
    hooks = [
        layer.register_forward_hook(
            lambda layer, _, out: counts.append(out[0, 0].numel() * len(out) * layer.weight.numel())
        )
        for layer in network.features.backbone.modules()
        if isinstance(layer, torch.nn.Conv2d)
    ]
    with torch.no_grad():
        network.embed(torch.from_numpy(speckle(1, config.image_shape)))
    for hook in hooks:
        hook.remove()
    return sum(counts)


@pytest.mark.parametrize('config', [VGG16, COMPACT], ids=['vgg16', 'compact'])
@pytest.mark.parametrize('share', [0.9, 0.5, 0.2])
def test_the_share_of_multiplications_is_reached(config: NetworkConfig, share: float) -> None:
    network = network_of(config)
    before = multiplications(network, config)
    factorise(network, speckle(6, config.image_shape), share)
    assert share - 0.05 < multiplications(network, config) / before <= share


@pytest.mark.parametrize('config', [VGG16, COMPACT], ids=['vgg16', 'compact'])
def test_more_multiplications_reduce_the_error(config: NetworkConfig) -> None:
    given = torch.from_numpy(speckle(6, config.image_shape))
    whole = network_of(config).embed(given)[0]
    errors = []
    for share in (0.9, 0.6, 0.3):
        network = network_of(config)
        factorise(network, given.numpy(), share)
        errors.append(float((network.embed(given)[0] - whole).detach().norm()))
    assert errors[0] < errors[1] < errors[2]


def test_repeated_filters_are_removed_without_an_error() -> None:
    network = network_of(VGG16)
    with torch.no_grad():
        for layer in vgg16_layers(network):
            if isinstance(layer, torch.nn.Conv2d):
                kept = layer.out_channels // 8
                layer.weight.copy_(layer.weight[:kept].repeat(8, 1, 1, 1))
                assert layer.bias is not None
                layer.bias.normal_(std=0.1)
    given = torch.from_numpy(speckle(6, VGG16.image_shape))
    before = network.embed(given)[0].detach()
    factorise(network, given.numpy(), 0.3)
    torch.testing.assert_close(network.embed(given)[0], before, rtol=1e-3, atol=1e-4)


def test_a_convolution_of_zeros() -> None:
    network = network_of(VGG16)
    dead = vgg16_layers(network)[10]
    assert isinstance(dead, torch.nn.Conv2d)
    assert dead.bias is not None
    torch.nn.init.zeros_(dead.weight)
    torch.nn.init.zeros_(dead.bias)
    factorise(network, speckle(2, VGG16.image_shape), 0.5)
    assert torch.isfinite(network.embed(torch.from_numpy(speckle(2, VGG16.image_shape)))[0]).all()


def test_an_export_is_another_model(save_random: Callable[[NetworkConfig], Path]) -> None:
    pytest.importorskip('onnx')
    config = NetworkConfig(dimension=8, side_px=32)
    weights = save_random(config)
    given = speckle(4, config.image_shape)
    scans = CalibrationScans(given, '4 images')
    exported = weights.with_name('half.onnx')
    parent = export_onnx(weights, weights.with_name('whole.onnx'))
    one = export_onnx(weights, exported, Compression(scans, low_rank=0.5))
    content = exported.read_bytes()
    assert export_onnx(weights, exported, Compression(scans, low_rank=0.5)) == one
    assert exported.read_bytes() == content
    other = export_onnx(weights, weights.with_name('less.onnx'), Compression(scans, low_rank=0.3))
    assert len({parent.fingerprint, one.fingerprint, other.fingerprint}) == 3
    assert f'low rank, 0.5 of {parent.fingerprint}, fitted to 4 images' in one.description
    found, expected = (OnnxEncoder(weights.with_name(f'{name}.onnx')).infer(given)[0] for name in ('half', 'whole'))
    assert 1e-4 < np.abs(found - expected).max() < 0.5
