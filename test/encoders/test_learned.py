"""The choice of runtime and weights file, by installed packages and existing files."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders import pretrained
from offradar_ros.encoders.learned import choose_runtime
from offradar_ros.errors import ConfigError, ModelError


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Pretends that only the given packages are installed."""

    def only(*packages: str) -> None:
        monkeypatch.setattr(importlib.util, 'find_spec', lambda name: object() if name in packages else None)

    return only


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(pretrained, 'FOLDER', tmp_path)
    for name in ('both.onnx', 'both.safetensors', 'torch_only.safetensors', 'onnx_only.onnx'):
        (tmp_path / name).write_bytes(b'')
    return tmp_path


BOTH_LEARNED = ('onnxruntime', 'torch', 'safetensors')


@pytest.mark.parametrize(
    ('weights', 'packages', 'backend', 'expected'),
    [
        ('both', BOTH_LEARNED, 'auto', 'both.onnx'),
        ('both', BOTH_LEARNED, 'torch', 'both.safetensors'),
        ('both', ('torch', 'safetensors'), 'auto', 'both.safetensors'),
        ('both', ('onnxruntime', 'safetensors'), 'auto', 'both.onnx'),
        ('torch_only', BOTH_LEARNED, 'auto', 'torch_only.safetensors'),
        ('onnx_only', BOTH_LEARNED, 'auto', 'onnx_only.onnx'),
    ],
)
def test_the_file_is_for_an_installed_runtime(
    folder: Path, installed: Callable[..., None], weights: str, packages: tuple[str, ...], backend: str, expected: str
) -> None:
    installed(*packages)
    assert choose_runtime(EncoderConfig('variational', weights, backend))[1] == folder / expected


def test_the_order_of_preference_can_be_changed(folder: Path, installed: Callable[..., None]) -> None:
    config = EncoderConfig('variational', 'both')
    installed(*BOTH_LEARNED)
    assert choose_runtime(config, ('torch', 'onnx'))[1] == folder / 'both.safetensors'
    installed('onnxruntime', 'safetensors')
    assert choose_runtime(config, ('torch', 'onnx'))[1] == folder / 'both.onnx'


@pytest.mark.parametrize(
    ('weights', 'message'),
    [
        ('both', 'both.onnx: needs the Python package onnxruntime, which is not installed (pip install onnxruntime)'),
        ('torch_only', 'torch_only.safetensors: needs the Python package torch, which is not installed (pip install'),
    ],
)
def test_the_error_without_a_runtime_says_what_to_install(
    folder: Path, installed: Callable[..., None], weights: str, message: str
) -> None:
    installed()
    with pytest.raises(ModelError) as refused:
        choose_runtime(EncoderConfig('variational', weights))
    assert message in str(refused.value)


def test_a_backend_without_a_file_is_refused(folder: Path) -> None:
    with pytest.raises(ConfigError, match=r'encoder\.weights: expected a \.safetensors file or the name'):
        choose_runtime(EncoderConfig('variational', 'onnx_only', 'torch'))
