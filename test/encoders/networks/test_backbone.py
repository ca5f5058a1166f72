"""The compact backbone: circular padding, rotation invariance, and the whole against loops."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from radar_images import speckle

pytest.importorskip('torch')

import torch

from offradar_ros.encoders.network_config import POLAR, NetworkConfig
from offradar_ros.encoders.networks.backbone import (
    COMPACT_CONVOLUTIONS,
    AzimuthSpectrum,
    Compact,
    make_backbone,
    measured,
    over_azimuth,
)
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.encoders.registry import LEARNED
from offradar_ros.radar.spinning import spin
from offradar_ros.types import PolarScan

UNCHANGED = 1e-5


def trained_a_little(network: Network, shape: tuple[int, int]) -> Network:
    """The network with batch statistics that differ from the initial ones."""
    network.train()(torch.from_numpy(speckle(8, shape)))
    return network.eval()


@pytest.mark.parametrize('azimuths, frequencies', [(25, 8), (25, 13), (8, 5), (8, 3), (1, 1), (2, 2), (7, 4)])
def test_spectrum_equals_that_of_a_fourier_transform(azimuths: int, frequencies: int) -> None:
    features = np.random.default_rng(0).normal(size=(2, 3, azimuths, 5)).astype(np.float32)
    found = AzimuthSpectrum(azimuths, frequencies)(torch.from_numpy(features))
    expected = np.abs(np.fft.rfft(features.astype(np.float64), axis=2))[:, :, :frequencies] / azimuths
    assert found.shape == (2, 3, frequencies, 5)
    # The amplitude is computed as the root of a² + 1e-10.
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=2e-5)


def test_spectrum_does_not_depend_on_the_first_row() -> None:
    features = torch.randn((1, 4, 25, 6), generator=torch.Generator().manual_seed(0))
    spectrum = AzimuthSpectrum(25, 8)
    for rows in range(1, 25):
        torch.testing.assert_close(spectrum(features.roll(rows, dims=2)), spectrum(features), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize('kind', [None, torch.bfloat16, torch.float16])
def test_spectrum_of_zeros_has_a_finite_gradient_in_any_precision(kind: torch.dtype | None) -> None:
    features = torch.zeros((1, 2, 16, 3), dtype=kind or torch.float32, requires_grad=True)
    with torch.autocast('cpu', dtype=kind, enabled=kind is not None):
        found = AzimuthSpectrum(16, 8)(features)
    assert found.dtype == torch.float32
    assert (found >= 0).all()
    found.sum().backward()
    assert features.grad is not None
    assert torch.isfinite(features.grad).all()


@pytest.mark.parametrize('name', POLAR)
@pytest.mark.parametrize(
    'shape, expected',
    [((200, 128), (48, 8, 16)), ((64, 32), (48, 5, 4)), ((112, 8), (48, 8, 1)), ((8, 16), (48, 1, 2))],
)
def test_feature_shapes(name: str, shape: tuple[int, int], expected: tuple[int, ...]) -> None:
    config = NetworkConfig(backbone=name, azimuths=shape[0], range_bins=shape[1])
    backbone = make_backbone(config).eval()
    assert isinstance(backbone, Compact)
    assert backbone.shape == expected
    with torch.no_grad():
        assert backbone(torch.rand(2, 1, *shape)).shape == (2, *expected)
        assert trained_a_little(make_network(config), shape).features(torch.zeros(3, *shape)).shape == (3, *expected)


@pytest.mark.parametrize(
    ('name', 'least'),
    [
        ('vgg16', 14_000_000),
        ('vgg16_bn', 14_000_000),
        ('compact', 150_000),
        ('compact_centred', 150_000),
        ('resnet50', 20_000_000),
    ],
)
def test_groups_are_all_weights_from_the_image_on(name: str, least: int) -> None:
    backbone = make_backbone(NetworkConfig(backbone=name, side_px=32, azimuths=16, range_bins=16))
    groups = [list(group.parameters()) for group in backbone.groups]
    assert len(groups) == 5
    numbers = [id(parameter) for group in groups for parameter in group]
    assert sorted(numbers) == sorted(id(parameter) for parameter in backbone.parameters())
    assert sum(parameter.numel() for parameter in backbone.parameters()) > least
    # With the first groups frozen the backward pass ends before them.
    for frozen in range(1, 5):
        backbone.groups[frozen - 1].requires_grad_(False)
        backbone.zero_grad()
        backbone.train()(torch.rand(2, 1, *((16, 16) if name in POLAR else (32, 32)))).sum().backward()
        for number, group in enumerate(groups):
            assert all((parameter.grad is None) == (number < frozen) for parameter in group)


def test_computed_constants_are_not_part_of_the_weights() -> None:
    one, other = Compact((64, 32)), Compact((200, 128))
    shapes = {name: tensor.shape for name, tensor in one.state_dict().items()}
    assert shapes == {name: tensor.shape for name, tensor in other.state_dict().items()}
    assert not any('spectrum' in name for name in shapes)


def convolved(features: NDArray[np.float64], layer: Any, stride: int) -> NDArray[np.float64]:
    """(C, A, R) → (C', A / stride, R / stride) in loops: rows are padded circularly, columns with zeros."""
    kernel = layer.convolution.weight.detach().double().numpy()
    normalise = layer.normalise
    size = kernel.shape[2]
    _, rows, columns = features.shape
    found = np.zeros((len(kernel), rows // stride, columns // stride))
    for i in range(rows // stride):
        for j in range(columns // stride):
            for u in range(size):
                for v in range(size):
                    row, column = (i * stride + u - size // 2) % rows, j * stride + v - size // 2
                    if 0 <= column < columns:
                        found[:, i, j] += kernel[:, :, u, v] @ features[:, row, column]
    mean, variance, weight, bias = (
        tensor.detach().double().numpy()[:, None, None]
        for tensor in (normalise.running_mean, normalise.running_var, normalise.weight, normalise.bias)
    )
    return np.asarray((found - mean) / np.sqrt(variance + normalise.eps) * weight + bias)


@settings(max_examples=50, deadline=None)
@given(image=arrays(np.uint8, (6, 5), elements=st.sampled_from([0, 0, 0, 1, 80, 255])))
def test_azimuths_without_power_take_no_part_in_mean_and_deviation(image: NDArray[np.uint8]) -> None:
    power = torch.from_numpy(image.astype(np.float32) / 255.0)[None, None]
    mask = measured(power)
    known = image.any(axis=1)
    assert mask.flatten().tolist() == known.astype(float).tolist()
    offset, standardised = (part[0, 0].numpy() for part in over_azimuth(power, mask))
    assert not offset[~known].any()
    assert not standardised[~known].any()
    if known.any():
        rows = image[known] / 255.0
        expected = rows - rows.mean(axis=0)
        np.testing.assert_allclose(offset[known], expected, atol=1e-6)
        np.testing.assert_allclose(standardised[known], expected / (rows.std(axis=0) + 0.01), atol=1e-4)


def test_without_azimuths_that_were_not_measured_all_count() -> None:
    power = torch.from_numpy(speckle(2, (16, 8)) / 255.0)[:, None].float()
    for one, other in zip(over_azimuth(power, measured(power)), over_azimuth(power, None), strict=True):
        torch.testing.assert_close(one, other)


def test_the_gain_of_a_receiver_does_not_change_features() -> None:
    torch.manual_seed(0)
    changes = {}
    for name in POLAR:
        config = NetworkConfig(backbone=name, dimension=4, azimuths=64, range_bins=32)
        network = trained_a_little(make_network(config), config.image_shape)
        # 10 dB are 20 in half decibels; no byte is at either end of its range.
        image = torch.from_numpy(np.clip(speckle(3, config.image_shape), 30.0, 200.0))
        with torch.no_grad():
            one, other = network.features(image), network.features(image + 20.0)
        changes[name] = ((one - other).abs().max() / one.abs().max()).item()
    assert changes['compact_centred'] < 1e-4
    assert changes['compact'] > 1e-2


@pytest.mark.parametrize('name', POLAR)
def test_the_whole_backbone_against_loops(name: str) -> None:
    torch.manual_seed(0)
    network = make_network(NetworkConfig(backbone=name, dimension=4, azimuths=16, range_bins=24))
    backbone = trained_a_little(network, (16, 24)).features.backbone
    assert isinstance(backbone, Compact)
    image = speckle(1, (16, 24)) / 255.0
    standardised = [
        [(image[0, a, r] - image[0, :, r].mean()) / (image[0, :, r].std() + 0.01) for r in range(24)] for a in range(16)
    ]
    offset = image[0] - image[0].mean(axis=0) if name == 'compact_centred' else image[0]
    both = np.stack([offset, 0.25 * np.array(standardised)])
    layers = [layer for layer in backbone.convolutions if not isinstance(layer, torch.nn.ReLU)]
    amplitudes = []
    for turn in (0, 2, 4, 6):
        features = np.roll(both, -turn, axis=1)
        for layer, (_, _, stride) in zip(layers, COMPACT_CONVOLUTIONS, strict=True):
            features = np.maximum(convolved(features, layer, stride), 0.0)
        features = convolved(features, backbone.reduce, 1)
        amplitudes.append(np.abs(np.fft.rfft(features, axis=1)) / 2)
    expected = np.mean(amplitudes, axis=0)
    assert expected.shape == backbone.shape == (48, 2, 3)
    with torch.no_grad():
        found = backbone(torch.from_numpy(image[None]).float())
    np.testing.assert_allclose(found[0], expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize('method', LEARNED)
def test_a_turn_by_two_rows_does_not_change_an_embedding(method: str, small_config: NetworkConfig) -> None:
    torch.manual_seed(2)
    network = make_network(dataclasses.replace(small_config, method=method))
    trained_a_little(network, small_config.image_shape)
    given = speckle(2, small_config.image_shape)
    with torch.no_grad():
        expected = network.embed(torch.from_numpy(given))
        for rows in range(2, 64, 10):
            found = network.embed(torch.from_numpy(np.roll(given, rows, axis=1)))
            for one, two in zip(found, expected, strict=True):
                assert (one - two).abs().max() <= UNCHANGED * two.abs().max()
        # Two images differ: the embedding is not constant.
        assert (expected[0][0] - expected[0][1]).abs().max() > 100 * UNCHANGED * expected[0].abs().max()


def test_a_turn_does_not_change_an_embedding_in_onnx(small_onnx: Path, street: PolarScan) -> None:
    pytest.importorskip('onnxruntime')
    from offradar_ros.encoders.onnx_backend import OnnxEncoder  # noqa: PLC0415

    encoder = OnnxEncoder(small_onnx, threads=1)
    expected = encoder.encode(street)
    # 400 rows of the scan are 64 of the image: 50 are 8 rows.
    for rows in (50, 150, 350):
        found = encoder.encode(spin(street, rows))
        assert np.abs(found.mean - expected.mean).max() <= UNCHANGED * np.abs(expected.mean).max()
        assert np.abs(found.variance - expected.variance).max() <= UNCHANGED * np.abs(expected.variance).max()
