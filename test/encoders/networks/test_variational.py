from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('torch')

import torch

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.backbone import make_backbone
from offradar_ros.encoders.networks.files import load_network, save_network
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.encoders.weights import load_weights, save_weights
from offradar_ros.errors import ModelError

SMALL = NetworkConfig(backbone='compact', dimension=8, azimuths=64, range_bins=32)


def images(count: int, shape: tuple[int, int] = SMALL.image_shape) -> torch.Tensor:
    return torch.randint(0, 200, (count, *shape), dtype=torch.uint8, generator=torch.Generator().manual_seed(1))


@pytest.fixture
def network() -> VariationalNetwork:
    torch.manual_seed(0)
    network = VariationalNetwork(SMALL)
    with torch.no_grad():
        network.log_variance.bias.normal_()
    return network.eval()


def test_vgg16_is_configuration_d() -> None:
    backbone = make_backbone(NetworkConfig())
    convolutions = [layer for layer in backbone.modules() if isinstance(layer, torch.nn.Conv2d)]
    assert len(convolutions) == 13
    assert sum(isinstance(layer, torch.nn.MaxPool2d) for layer in backbone.modules()) == 5
    assert sum(p.numel() for p in backbone.parameters()) == 14_714_688  # the published count
    # Names of the first and last convolution in torchvision's weights.
    assert {'features.0.weight', 'features.28.bias'} <= backbone.state_dict().keys()
    assert len(backbone.state_dict()) == 26


@pytest.mark.parametrize('backbone, shape', [('vgg16', (512, 3, 3)), ('compact', (48, 8, 4))])
def test_shapes(backbone: str, shape: tuple[int, ...]) -> None:
    config = NetworkConfig(backbone=backbone, dimension=16, side_px=96, azimuths=120, range_bins=32)
    out = VariationalNetwork(config).train()(images(2, config.image_shape))
    for part in (out.z_i, out.mu, out.log_variance, out.z):
        assert part.shape == (2, 16)
    assert out.features.shape == out.reconstruction.shape == (2, *shape)


def test_the_feature_map_of_the_paper() -> None:
    assert make_backbone(NetworkConfig()).shape == (512, 8, 8)


def test_training_samples_around_the_posterior_mean(network: VariationalNetwork) -> None:
    network.train()
    one_image = images(1)
    network.features.eval()  # batch statistics would differ from the running ones below
    with torch.no_grad():
        features = network.features(one_image).flatten(1)
        z_i, mu, log_variance = network.z_i(features), network.mu(features), network.log_variance(features)
        z = torch.cat([network(one_image.expand(100, -1, -1)).z for _ in range(20)])
    np.testing.assert_allclose(z.mean(0), (z_i + mu)[0], atol=0.25)
    np.testing.assert_allclose(z.std(0), torch.exp(0.5 * log_variance)[0], rtol=0.15)


def test_evaluation_does_not_sample(network: VariationalNetwork) -> None:
    with torch.no_grad():
        first, second = network(images(3)), network(images(3))
    assert torch.equal(first.z, second.z)
    assert torch.equal(first.z, first.z_i + first.mu)


@pytest.mark.parametrize('descriptor', ['z_i', 'z_i_plus_mu'])
def test_embedding_is_the_configured_descriptor_and_the_posterior_variance(descriptor: str) -> None:
    torch.manual_seed(0)
    network = VariationalNetwork(dataclasses.replace(SMALL, descriptor=descriptor)).eval()
    with torch.no_grad():
        mean, variance = network.embed(images(2))
        out = network(images(2))
    expected = out.z_i if descriptor == 'z_i' else out.z_i + out.mu
    assert torch.allclose(mean, expected / expected.norm(dim=1, keepdim=True))
    assert torch.equal(variance, out.log_variance.exp())


def test_variance_starts_at_the_prior() -> None:
    with torch.no_grad():
        _, variance = VariationalNetwork(SMALL).eval().embed(images(4))
    np.testing.assert_allclose(variance, 1.0, atol=0.05)


@pytest.mark.parametrize('bias, expected', [(1e6, np.exp(10.0)), (-1e6, np.exp(-10.0))])
def test_variance_stays_finite_and_positive(network: VariationalNetwork, bias: float, expected: float) -> None:
    with torch.no_grad():
        network.log_variance.bias.fill_(bias)
        _, variance = network.embed(images(1))
    np.testing.assert_allclose(variance, expected, rtol=1e-5)


def test_reconstruction_has_gradients_in_all_parts_but_not_in_its_target(network: VariationalNetwork) -> None:
    out = network.train()(images(2))
    assert not out.features.requires_grad
    (out.reconstruction - out.features).pow(2).mean().backward()
    for part in (network.decoder, network.z_i, network.mu, network.log_variance, network.features):
        assert all(p.grad is not None and bool(p.grad.abs().sum() > 0) for p in part.parameters() if p.dim() > 1)


def test_weights_round_trip(tmp_path: Path, network: VariationalNetwork) -> None:
    path = tmp_path / 'net.safetensors'
    header = save_network(path, network, 'a test')
    again, found = load_network(path)
    assert found == header
    assert not again.training
    with torch.no_grad():
        for one, two in zip(network.embed(images(2)), again.embed(images(2)), strict=True):
            assert torch.equal(one, two)


def test_half_precision_weights_run_in_single_precision(tmp_path: Path, network: VariationalNetwork) -> None:
    path = tmp_path / 'half.safetensors'
    state = {name: tensor.numpy() for name, tensor in network.state_dict().items()}
    save_weights(path, SMALL, {name: t.astype(np.float16) if t.dtype == np.float32 else t for name, t in state.items()})
    again, _ = load_network(path)
    with torch.no_grad():
        mean, _ = again.embed(images(2))
        expected, _ = network.embed(images(2))
    assert mean.dtype == torch.float32
    np.testing.assert_allclose(mean, expected, atol=1e-2 * float(expected.abs().max()))


def test_tensors_that_do_not_match_are_named(tmp_path: Path, network: VariationalNetwork) -> None:
    save_network(tmp_path / 'net.safetensors', network)
    _, tensors = load_weights(tmp_path / 'net.safetensors')
    cases = {
        'tensor mu.bias is missing': {name: t for name, t in tensors.items() if name != 'mu.bias'},
        'tensor mu.bias: expected shape (8,), got (3,)': {**tensors, 'mu.bias': np.zeros(3, np.float32)},
        'tensor extra is not part of a compact variational network': {**tensors, 'extra': np.zeros(3, np.float32)},
    }
    for expected, changed in cases.items():
        path = tmp_path / 'changed.safetensors'
        save_weights(path, SMALL, changed)
        with pytest.raises(ModelError) as refused:
            load_network(path)
        assert str(refused.value) == f'{path}: {expected}'
