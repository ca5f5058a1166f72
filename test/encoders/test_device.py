"""Devices of learned encoders: the choice on simulated machines, and the behaviour of this one."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.device import onnx_providers, torch_device, used_device
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError, ModelError

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
def test_providers_are_the_available_ones_of_the_device(
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
def test_torch_runs_on_the_configured_device(device: str, has_cuda: bool, expected: str) -> None:
    assert torch_device(device, '2.9', has_cuda) == expected


def test_cuda_without_a_gpu_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match=rf"parameter encoder.device: .* offers AzureEP, {CPU}, got 'cuda'$"):
        onnx_providers('cuda', ['AzureEP', CPU])
    with pytest.raises(ConfigError, match=r"parameter encoder.device: .* torch 2.9\+cpu finds no GPU, got 'cuda'$"):
        torch_device('cuda', '2.9+cpu', False)


def test_a_provider_that_is_available_and_does_not_start_is_reported() -> None:
    assert used_device('cuda', [CUDA, CPU]) == 'cuda'
    assert used_device('auto', [CPU]) == 'cpu'
    with pytest.raises(ConfigError, match=rf'parameter encoder.device: .* could not start {CUDA} and took {CPU}'):
        used_device('cuda', [CPU])


@pytest.fixture
def gpu_that_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    """ONNX Runtime with a provider for a GPU that raises an error at its start."""
    session = onnxruntime.InferenceSession

    def start(path: str, options: Any, providers: list[str]) -> Any:
        if CUDA in providers:
            raise RuntimeError('CUDA failure 100: no CUDA-capable device is detected\nGPU=0')
        return session(path, options, providers=providers)

    monkeypatch.setattr(onnxruntime, 'InferenceSession', start)
    monkeypatch.setattr(onnxruntime, 'get_available_providers', lambda: [CUDA, CPU])


@pytest.mark.usefixtures('gpu_that_raises')
def test_a_gpu_that_raises_is_reported_or_not_used(small_onnx: Path) -> None:
    config = EncoderConfig(name='variational', weights=str(small_onnx))
    assert make_encoder(config).runs_on == 'cpu'
    message = rf'parameter encoder.device: .* could not start {CUDA} \(CUDA failure 100: .* is detected\), got .cuda.$'
    with pytest.raises(ConfigError, match=message):
        make_encoder(dataclasses.replace(config, device='cuda'))


@pytest.mark.usefixtures('gpu_that_raises')
@pytest.mark.parametrize('device', ['auto', 'cuda'])
def test_a_damaged_file_is_not_reported_as_a_gpu_error(tmp_path: Path, device: str) -> None:
    (tmp_path / 'damaged.onnx').write_bytes(b'no network')
    with pytest.raises(ModelError, match=r'damaged\.onnx: not a readable ONNX file'):
        make_encoder(EncoderConfig(name='variational', weights=str(tmp_path / 'damaged.onnx'), device=device))


@pytest.mark.parametrize('suffix', ['.onnx', '.safetensors'])
def test_the_device_is_not_part_of_the_model(small_onnx: Path, suffix: str) -> None:
    weights = str(small_onnx.with_suffix(suffix))
    encoder = make_encoder(EncoderConfig(name='variational', weights=weights, device='cpu'))
    assert encoder.runs_on == 'cpu'
    assert 'device' not in encoder.info.metadata


@pytest.mark.parametrize('suffix', ['.onnx', '.safetensors'])
def test_cuda_agrees_with_the_cpu_or_is_refused_in_one_line(small_onnx: Path, suffix: str) -> None:
    weights = str(small_onnx.with_suffix(suffix))
    on_cpu = make_encoder(EncoderConfig(name='variational', weights=weights, device='cpu'))
    try:
        on_gpu = make_encoder(EncoderConfig(name='variational', weights=weights, device='cuda'))
    except ConfigError as refused:
        assert str(refused).startswith('parameter encoder.device: expected a GPU')
        assert '\n' not in str(refused)
        return
    assert isinstance(on_cpu, ImageEncoder)
    assert isinstance(on_gpu, ImageEncoder)
    assert on_gpu.runs_on == 'cuda'
    assert on_gpu.info == on_cpu.info
    given = np.random.default_rng(0).integers(0, 255, (5, *on_cpu.header.config.image_shape)).astype(np.uint8)
    for found, expected in zip(on_gpu.infer(given), on_cpu.infer(given), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-2, atol=1e-3)
