"""The network of every learned method: descriptor, variance and agreement of the runtimes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from radar_images import speckle

pytest.importorskip('torch')
pytest.importorskip('onnx')
pytest.importorskip('onnxruntime')

import onnx
import torch

from offradar_ros.encoders.export.onnx_export import export_onnx
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.files import load_network, save_network
from offradar_ros.encoders.networks.mc_dropout import PASSES, McDropoutNetwork
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.encoders.networks.stun import StunNetwork
from offradar_ros.encoders.networks.vae import VaeNetwork
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.encoders.onnx_backend import OnnxEncoder
from offradar_ros.encoders.registry import LEARNED
from offradar_ros.encoders.torch_backend import TorchEncoder

AGREEMENT = 1e-4


def small(method: str) -> NetworkConfig:
    return NetworkConfig(method=method, backbone='compact', dimension=8, azimuths=64, range_bins=32, resolution_m=2.0)


def images(count: int = 4, shape: tuple[int, int] = (64, 32)) -> NDArray[np.uint8]:
    return speckle(count, shape)


def network_of(method: str) -> Network:
    """A network of random weights, with batch statistics and variances that differ from the initial ones."""
    torch.manual_seed(3)
    network = make_network(small(method))
    if isinstance(network, (VariationalNetwork, VaeNetwork, StunNetwork)):
        with torch.no_grad():
            network.log_variance.weight.normal_(std=0.05)
    network(torch.from_numpy(images()))
    return network.eval()


@pytest.fixture(params=LEARNED)
def method(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


def test_embedding_is_deterministic_and_has_the_configured_dimension(method: str) -> None:
    network = network_of(method)
    assert network.config == small(method)
    given = torch.from_numpy(images())
    first, second = network.embed(given), network.embed(given)
    for one, two in zip(first, second, strict=True):
        assert one.shape == (4, 8)
        assert one.dtype == torch.float32
        assert torch.equal(one, two)
    assert (first[1] >= 0).all()
    for whole, single in zip(first, network.embed(given[2:3].float()), strict=True):
        torch.testing.assert_close(whole[2:3], single, rtol=1e-4, atol=1e-6)


def test_variance_differs_between_scans_except_for_bc_radar(method: str) -> None:
    uncertainty = network_of(method).embed(torch.from_numpy(images()))[1].mean(dim=1)
    if method == 'bc_radar':
        assert torch.equal(uncertainty, torch.ones(4))
    else:
        assert uncertainty.std() > 1e-5


@pytest.mark.parametrize('method', ['variational', 'bc_radar', 'mc_dropout', 'stun'])
def test_descriptors_of_contrastive_methods_are_l2_normalised(method: str) -> None:
    descriptor, _ = network_of(method).embed(torch.from_numpy(images()))
    torch.testing.assert_close(descriptor.norm(dim=1), torch.ones(4))


@pytest.mark.parametrize('half', [False, True])
def test_onnx_agrees_with_torch(tmp_path: Path, method: str, half: bool) -> None:
    weights, exported = tmp_path / 'net.safetensors', tmp_path / 'net.onnx'
    header = save_network(weights, network_of(method), half=half)
    assert export_onnx(weights, exported) == header
    one, two = OnnxEncoder(exported, threads=1), TorchEncoder(weights)
    assert one.header == two.header == header
    assert one.info == dataclasses.replace(two.info, metadata=one.info.metadata)
    assert one.info.name == method
    for found, expected in zip(one.infer(images()), two.infer(images()), strict=True):
        assert np.abs(found - expected).max() <= AGREEMENT * np.abs(expected).max()


def test_half_precision_halves_both_files_and_changes_outputs_little(tmp_path: Path, method: str) -> None:
    network, sizes, embedded = network_of(method), {}, {}
    for half in (False, True):
        weights, exported = tmp_path / f'{half}.safetensors', tmp_path / f'{half}.onnx'
        save_network(weights, network, half=half)
        export_onnx(weights, exported)
        sizes[half] = [weights.stat().st_size, exported.stat().st_size]
        loaded, header = load_network(weights)
        assert header.stored == ('float16' if half else 'float32')
        assert {tensor.dtype for tensor in loaded.parameters()} == {torch.float32}
        embedded[half] = loaded.embed(torch.from_numpy(images()))
    for small_size, size in zip(sizes[True], sizes[False], strict=True):
        assert small_size < 0.6 * size
    for rounded, exact in zip(embedded[True], embedded[False], strict=True):
        torch.testing.assert_close(rounded, exact, rtol=0, atol=0.01 * float(exact.detach().abs().max()))


def test_half_precision_onnx_has_the_weights_of_the_file(tmp_path: Path) -> None:
    network = network_of('bc_radar')
    weights, exported = tmp_path / 'net.safetensors', tmp_path / 'net.onnx'
    save_network(weights, network, half=True)
    export_onnx(weights, exported)
    stored = [onnx.numpy_helper.to_array(tensor) for tensor in onnx.load(exported).graph.initializer]
    for tensor in load_network(weights)[0].parameters():
        if tensor.ndim >= 2:
            kernel = tensor.detach().numpy()
            assert any(half.dtype == np.float16 and np.array_equal(half, kernel) for half in stored)


def test_dropout_passes_against_a_loop_over_masks() -> None:
    network = network_of('mc_dropout')
    assert isinstance(network, McDropoutNetwork)
    given = torch.from_numpy(images())
    flat = network.features(given).flatten(1)
    votes = []
    for mask in network.masks:
        kept = torch.where(mask, flat / (1 - network.config.dropout), torch.zeros(()))
        vote = torch.stack([network.head.weight @ row + network.head.bias for row in kept])
        votes.append(vote / vote.square().sum(dim=1, keepdim=True).sqrt())
    assert len(votes) == PASSES == 20
    mean = torch.stack(votes).mean(dim=0)
    descriptor, variance = network.embed(given)
    torch.testing.assert_close(descriptor, mean / mean.norm(dim=1, keepdim=True), rtol=1e-4, atol=1e-5)
    expected = 8 * torch.stack([(vote - mean) ** 2 for vote in votes]).mean(dim=0)
    torch.testing.assert_close(variance, expected, rtol=1e-3, atol=1e-5)
    # U = 1 − |z̄|².
    torch.testing.assert_close(variance.mean(dim=1), 1 - mean.square().sum(dim=1), rtol=1e-4, atol=1e-5)


def test_masks_are_constant_and_have_the_configured_probability() -> None:
    one = make_network(dataclasses.replace(small('mc_dropout'), dropout=0.3))
    two = make_network(dataclasses.replace(small('mc_dropout'), dropout=0.3))
    assert isinstance(one, McDropoutNetwork)
    assert isinstance(two, McDropoutNetwork)
    assert torch.equal(one.masks, two.masks)
    assert abs(one.masks.float().mean().item() - 0.7) < 0.02
    assert len({row.numpy().tobytes() for row in one.masks}) == PASSES


def test_dropout_is_random_in_training_only() -> None:
    network = network_of('mc_dropout')
    given = torch.from_numpy(images())
    assert torch.equal(network(given), network(given))
    network.train()
    assert not torch.equal(network(given), network(given))


def test_a_bounded_student_s_variance_is_between_1_and_e() -> None:
    _, variance = network_of('stun').embed(torch.from_numpy(images()))
    assert (variance > 1).all()
    assert (variance < np.e).all()


def test_a_free_student_s_variance_is_clamped_at_exp_10() -> None:
    network = make_network(dataclasses.replace(small('stun'), student='free')).eval()
    assert isinstance(network, StunNetwork)
    torch.nn.init.zeros_(network.log_variance.weight)
    for bias, expected in ((-3.0, np.exp(-3.0)), (-50.0, np.exp(-10.0)), (5.0, np.exp(5.0))):
        torch.nn.init.constant_(network.log_variance.bias, bias)
        _, variance = network.embed(torch.from_numpy(images()))
        np.testing.assert_allclose(variance.detach().numpy(), expected, rtol=1e-5)


def test_auto_encoder_reconstructs_a_cartesian_image_averaged_over_4_pixels() -> None:
    config = NetworkConfig(method='vae', backbone='vgg16', dimension=8, side_px=32)
    output = make_network(config).eval()(torch.from_numpy(images(shape=(32, 32))))
    assert output.target.shape == output.reconstruction.shape == (4, 1, 8, 8)
    np.testing.assert_allclose(output.target[:, 0], averaged_over_4(images(shape=(32, 32))), rtol=1e-5)


def test_auto_encoder_reconstructs_rotation_invariant_amplitudes_of_a_polar_image() -> None:
    network, given = network_of('vae'), images()
    output = network(torch.from_numpy(given))
    assert output.target.shape == output.reconstruction.shape == (4, 1, 9, 8)
    by_hand = np.abs(np.fft.rfft(averaged_over_4(given), axis=1)) / 16
    np.testing.assert_allclose(output.target[:, 0], by_hand, rtol=1e-4, atol=2e-5)
    turned = network(torch.from_numpy(np.roll(given, 24, axis=1)))
    torch.testing.assert_close(turned.target, output.target, rtol=1e-4, atol=2e-5)


def test_auto_encoder_samples_in_training_only() -> None:
    network, given = network_of('vae'), torch.from_numpy(images())
    assert isinstance(network, VaeNetwork)
    assert torch.equal(network(given).reconstruction, network(given).reconstruction)
    network.train()
    assert not torch.equal(network(given).reconstruction, network(given).reconstruction)


def averaged_over_4(given: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Means of 4 × 4 pixels, in [0, 1]."""
    count, rows, columns = given.shape
    return np.asarray(given.astype(np.float64).reshape(count, rows // 4, 4, columns // 4, 4).mean(axis=(2, 4)) / 255)
