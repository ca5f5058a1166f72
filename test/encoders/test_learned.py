"""Which runtime and which file are used, by what is installed and what weights there are."""

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
    """Makes the given packages the only ones that seem to be installed."""

    def only(*packages: str) -> None:
        monkeypatch.setattr(importlib.util, 'find_spec', lambda name: object() if name in packages else None)

    return only


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(pretrained, 'FOLDER', tmp_path)
    for name in ('both.onnx', 'both.safetensors', 'torch_alone.safetensors', 'onnx_alone.onnx'):
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
        ('torch_alone', BOTH_LEARNED, 'auto', 'torch_alone.safetensors'),
        ('onnx_alone', BOTH_LEARNED, 'auto', 'onnx_alone.onnx'),
    ],
)
def test_the_file_is_one_that_an_installed_runtime_reads(
    folder: Path, installed: Callable[..., None], weights: str, packages: tuple[str, ...], backend: str, expected: str
) -> None:
    installed(*packages)
    assert choose_runtime(EncoderConfig('variational', weights, backend))[1] == folder / expected


def test_an_evaluation_prefers_torch_where_there_is_one(folder: Path, installed: Callable[..., None]) -> None:
    config = EncoderConfig('variational', 'both')
    installed(*BOTH_LEARNED)
    assert choose_runtime(config, ('torch', 'onnx'))[1] == folder / 'both.safetensors'
    installed('onnxruntime', 'safetensors')
    assert choose_runtime(config, ('torch', 'onnx'))[1] == folder / 'both.onnx'


@pytest.mark.parametrize(
    ('weights', 'said'),
    [
        ('both', 'both.onnx: needs the Python package onnxruntime, which is not installed (pip install onnxruntime)'),
        ('torch_alone', 'torch_alone.safetensors: needs the Python package torch, which is not installed (pip install'),
    ],
)
def test_without_a_runtime_it_is_said_what_to_install(
    folder: Path, installed: Callable[..., None], weights: str, said: str
) -> None:
    installed()
    with pytest.raises(ModelError) as refused:
        choose_runtime(EncoderConfig('variational', weights))
    assert said in str(refused.value)


def test_a_backend_without_a_file_is_refused(folder: Path) -> None:
    with pytest.raises(ConfigError, match=r'encoder\.weights: expected a \.safetensors file or the name'):
        choose_runtime(EncoderConfig('variational', 'onnx_alone', 'torch'))
