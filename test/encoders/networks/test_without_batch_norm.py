"""Batch normalisation that becomes part of the convolutions."""

from __future__ import annotations

import dataclasses

import pytest

pytest.importorskip('torch')

import torch

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.encoders.networks.without_batch_norm import without_batch_norm
from offradar_ros.encoders.registry import LEARNED

CONFIG = NetworkConfig(backbone='vgg16_bn', dimension=8, side_px=32, resolution_m=4.0)


@pytest.mark.parametrize('method', LEARNED)
def test_the_plain_network_has_the_same_outputs(method: str) -> None:
    torch.manual_seed(0)
    network = make_network(dataclasses.replace(CONFIG, method=method))
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.02 * torch.randn_like(parameter))
        images = torch.randint(0, 256, (6, 32, 32), dtype=torch.uint8)
        network.train().features(images)
        plain = without_batch_norm(network)
        assert plain.config == dataclasses.replace(network.config, backbone='vgg16')
        assert not any(isinstance(layer, torch.nn.BatchNorm2d) for layer in plain.features.backbone.modules())
        for found, expected in zip(plain.embed(images), network.embed(images), strict=True):
            torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)
        assert (plain.embed(images)[0].std(dim=0) > 1e-4).any()


@pytest.mark.parametrize('backbone', ['vgg16', 'compact_centred', 'resnet50'])
def test_other_networks_stay_as_they_are(backbone: str) -> None:
    network = make_network(dataclasses.replace(CONFIG, backbone=backbone, azimuths=16, range_bins=16))
    assert without_batch_norm(network) is network
    assert not network.training
