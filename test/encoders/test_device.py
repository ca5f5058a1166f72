"""Where learned encoders run: the choice, with made-up machines, and what this one really does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.device import onnx_providers, torch_device, used_provider
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError

CUDA, CPU = 'CUDAExecutionProvider', 'CPUExecutionProvider'


@pytest.mark.parametrize(
    'device, available, expected',
    [
        ('auto', [CPU], (CPU,)),
        ('auto', ['TensorrtExecutionProvider', CUDA, CPU], (CUDA, CPU)),
        ('auto', [CPU, CUDA], (CUDA, CPU)),
        ('auto', ['AzureExecutionProvider', CPU], (CPU,)),
        ('cpu', [CUDA, CPU], (CPU,)),
        ('cuda', ['TensorrtExecutionProvider', CUDA, CPU], (CUDA, CPU)),
    ],
)
def test_providers_are_those_asked_for_that_there_are(
    device: str, available: list[str], expected: tuple[str, ...]
) -> None:
    assert onnx_providers(device, available) == expected


@pytest.mark.parametrize(
    'device, has_cuda, expected',
    [
        ('auto', True, 'cuda'),
        ('auto', False, 'cpu'),
        ('cpu', True, 'cpu'),
        ('cpu', False, 'cpu'),
        ('cuda', True, 'cuda'),
    ],
)
def test_torch_runs_where_it_is_asked_to(device: str, has_cuda: bool, expected: str) -> None:
    assert torch_device(device, '2.9', has_cuda) == expected


def test_cuda_where_there_is_none_is_refused_in_a_line() -> None:
    with pytest.raises(ConfigError, match=rf"parameter encoder.device: .* offers AzureEP, {CPU}, got 'cuda'$"):
        onnx_providers('cuda', ['AzureEP', CPU])
    with pytest.raises(ConfigError, match=r"parameter encoder.device: .* torch 2.9\+cpu finds no GPU, got 'cuda'$"):
        torch_device('cuda', '2.9+cpu', False)


def test_a_provider_that_is_offered_and_does_not_start_is_noticed() -> None:
    assert used_provider('cuda', [CUDA, CPU]) == CUDA
    assert used_provider('auto', [CPU]) == CPU
    with pytest.raises(ConfigError, match=rf'parameter encoder.device: .* could not start {CUDA} and took {CPU}'):
        used_provider('cuda', [CPU])


@pytest.mark.parametrize('suffix, used', [('.onnx', CPU), ('.safetensors', 'cpu')])
def test_the_model_says_what_it_runs_on(small_onnx: Path, suffix: str, used: str) -> None:
    weights = str(small_onnx.with_suffix(suffix))
    encoder = make_encoder(EncoderConfig(name='variational', weights=weights, device='cpu'))
    assert encoder.info.metadata['device'] == used


@pytest.mark.parametrize('suffix', ['.onnx', '.safetensors'])
def test_cuda_gives_what_the_cpu_gives_or_one_line(small_onnx: Path, suffix: str) -> None:
    weights = str(small_onnx.with_suffix(suffix))
    on_cpu = make_encoder(EncoderConfig(name='variational', weights=weights, device='cpu'))
    try:
        on_gpu = make_encoder(EncoderConfig(name='variational', weights=weights, device='cuda'))
    except ConfigError as refused:
        assert str(refused).startswith('parameter encoder.device: expected a GPU')
        assert '\n' not in str(refused)
        return
    assert 'cuda' in on_gpu.info.metadata['device'].lower()
    assert on_gpu.info.fingerprint == on_cpu.info.fingerprint
    given = np.random.default_rng(0).integers(0, 255, (5, *on_cpu.header.config.image_shape), np.uint8)
    for found, expected in zip(on_gpu.infer(given), on_cpu.infer(given), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-2, atol=1e-3)
