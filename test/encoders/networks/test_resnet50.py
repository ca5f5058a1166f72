"""ResNet-50 as in He et al. and torchvision, and the pooling of STUN."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from radar_images import speckle

pytest.importorskip('torch')

import torch

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.backbone import make_backbone
from offradar_ros.encoders.networks.bc_radar import BcRadarNetwork
from offradar_ros.encoders.networks.files import save_network
from offradar_ros.encoders.networks.mc_dropout import McDropoutNetwork
from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.encoders.networks.resnet50 import Bottleneck, GeneralisedMean, Resnet50
from offradar_ros.encoders.networks.stun import StunNetwork
from offradar_ros.encoders.torch_backend import TorchEncoder

STUN = NetworkConfig(method='stun', backbone='resnet50', dimension=16, side_px=64)


def test_names_and_number_of_weights_are_those_of_torchvision() -> None:
    shapes = {name: tuple(tensor.shape) for name, tensor in Resnet50(64).state_dict().items()}
    parameters = sum(np.prod(shape) for name, shape in shapes.items() if name.split('.')[-1] in ('weight', 'bias'))
    # 25,557,032 with the classifier's 2048 × 1000 + 1000.
    assert parameters == 25_557_032 - 2_049_000
    assert len([name for name, shape in shapes.items() if len(shape) == 4]) == 53
    assert shapes['conv1.weight'] == (64, 3, 7, 7)
    assert shapes['bn1.running_mean'] == (64,)
    assert shapes['layer1.0.downsample.0.weight'] == (256, 64, 1, 1)
    assert shapes['layer3.5.conv2.weight'] == (256, 256, 3, 3)
    assert shapes['layer4.0.downsample.1.running_var'] == (2048,)
    assert 'layer4.1.downsample.0.weight' not in shapes
    assert {name.split('.')[0] for name in shapes} == {'conv1', 'bn1', 'layer1', 'layer2', 'layer3', 'layer4'}


@pytest.mark.parametrize('side_px', [32, 96])
def test_feature_shapes(side_px: int) -> None:
    backbone = make_backbone(dataclasses.replace(STUN, side_px=side_px)).eval()
    assert backbone.shape == (2048, side_px // 32, side_px // 32)
    with torch.no_grad():
        assert backbone(torch.rand(2, 1, side_px, side_px)).shape == (2, *backbone.shape)


def test_a_block_adds_its_input() -> None:
    block = Bottleneck(256, 64, 1).eval()
    torch.nn.init.zeros_(block.bn3.weight)
    given = torch.randn((1, 256, 5, 7), generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(block(given), given.relu())
    halved = Bottleneck(256, 128, 2).eval()
    assert halved(given).shape == (1, 512, 3, 4)


def test_generalised_mean_of_several_powers() -> None:
    features = np.random.default_rng(1).gamma(1.0, 1.0, (2, 3, 4, 5)).astype(np.float32)
    pool = GeneralisedMean()
    for power in (1.0, 3.0, 40.0):
        torch.nn.init.constant_(pool.power, power)
        expected = np.power(np.power(features.astype(np.float64), power).mean(axis=(2, 3)), 1 / power)
        found = pool(torch.from_numpy(features)).detach()
        assert found.shape == (2, 3, 1, 1)
        np.testing.assert_allclose(found[:, :, 0, 0], expected, rtol=1e-4)
    assert (pool(torch.zeros(1, 2, 3, 3)) >= 0).all()


@pytest.mark.parametrize('method', ['stun', 'bc_radar', 'mc_dropout'])
def test_stun_bc_radar_and_mc_dropout_have_pooled_features(method: str) -> None:
    for side_px in (32, 64):
        network = make_network(dataclasses.replace(STUN, method=method, side_px=side_px))
        assert isinstance(network, (StunNetwork, BcRadarNetwork, McDropoutNetwork))
        assert network.features.flat == network.head.in_features == 2048
        network.eval()
        with torch.no_grad():
            mean, variance = network.embed(torch.from_numpy(speckle(2, (side_px, side_px))))
        assert mean.shape == variance.shape == (2, 16)


@pytest.mark.parametrize('method', ['variational', 'vae'])
def test_methods_with_a_decoder_have_the_full_feature_map(method: str) -> None:
    network = make_network(dataclasses.replace(STUN, method=method))
    assert network.features.shape == (2048, 2, 2)
    assert network.features.pool is None


def test_the_power_of_the_pooling_is_trained_and_saved(tmp_path: Path) -> None:
    network = make_network(STUN)
    network(torch.from_numpy(speckle(2, (64, 64))))[0].sum().backward()
    pool = network.features.pool
    assert pool is not None
    assert pool.power.grad is not None
    assert pool.power.grad.abs() > 0
    torch.nn.init.constant_(pool.power, 2.0)
    save_network(tmp_path / 'two.safetensors', network.eval())
    torch.nn.init.constant_(pool.power, 5.0)
    save_network(tmp_path / 'five.safetensors', network)
    found = [TorchEncoder(tmp_path / f'{name}.safetensors').infer(speckle(1, (64, 64)))[0] for name in ('two', 'five')]
    assert np.abs(found[0] - found[1]).max() > 1e-4
