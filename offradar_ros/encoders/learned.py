"""The learned encoder: chooses a runtime and a weights file. Runtimes are imported when they are used."""

from __future__ import annotations

import dataclasses
import importlib.util
import pkgutil
from collections.abc import Sequence
from pathlib import Path

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.errors import ConfigError, ModelError


@dataclasses.dataclass(frozen=True)
class Runtime:
    """Software that runs a network.

    Attributes:
        suffix: suffix of the weights files that it reads.
        packages: Python packages that it needs.
        encoder: ``module:class`` of its `ImageEncoder`, called with file, threads and device.
        devices: values of `encoder.device` that it supports.
        install: how to install a missing package.
    """

    suffix: str
    packages: tuple[str, ...]
    encoder: str
    devices: tuple[str, ...]
    install: str


RUNTIMES = {
    'onnx': Runtime(
        '.onnx',
        ('onnxruntime',),
        'offradar_ros.encoders.onnx_backend:OnnxEncoder',
        ('auto', 'cpu', 'cuda'),
        'pip install onnxruntime',
    ),
    'opencv': Runtime(
        '.onnx',
        ('cv2',),
        'offradar_ros.encoders.opencv_backend:OpencvEncoder',
        ('auto', 'cpu'),
        'apt install python3-opencv',
    ),
    'torch': Runtime(
        '.safetensors',
        ('torch', 'safetensors'),
        'offradar_ros.encoders.torch_backend:TorchEncoder',
        ('auto', 'cpu', 'cuda'),
        'pip install torch safetensors, or use a .onnx file made by offradar export',
    ),
}
"""Runtimes by the values of the parameter `encoder.backend`, in the order of preference of ``auto``."""


def make_learned(config: EncoderConfig) -> ImageEncoder:
    """The learned encoder of `config`; ConfigError and ModelError as `choose_runtime`, and for invalid weights."""
    runtime, path = choose_runtime(config)
    encoder: ImageEncoder = pkgutil.resolve_name(runtime.encoder)(path, config.threads, config.device)
    if encoder.info.name != config.name:
        raise ConfigError(
            f'parameter encoder.name: {config.weights} holds a network of {encoder.info.name}, got {config.name!r}'
        )
    return encoder


def choose_runtime(config: EncoderConfig, preferred: Sequence[str] = tuple(RUNTIMES)) -> tuple[Runtime, Path]:
    """The runtime and the weights file for `config`: the first of `preferred` that is installed and has a file.

    ConfigError if weights and backend do not match, ModelError if no matching runtime is installed.
    """
    allowed = [RUNTIMES[name] for name in preferred if config.backend in ('auto', name)]
    if config.backend == 'auto':
        allowed = [runtime for runtime in allowed if config.device in runtime.devices]
    installed = [runtime for runtime in allowed if not _missing(runtime)]
    # If nothing is installed, a file is still found, for the error message below.
    path = find_weights(config.weights, tuple(dict.fromkeys(r.suffix for r in (*installed, *allowed))))
    fitting = [runtime for runtime in allowed if runtime.suffix == path.suffix]
    if not fitting:
        raise ConfigError(_does_not_fit(config, path, [runtime.suffix for runtime in allowed]))
    for runtime in fitting:
        if runtime in installed:
            return runtime, path
    missing = _missing(fitting[0])[0]
    raise ModelError(f'{path}: needs the Python package {missing}, which is not installed ({fitting[0].install})')


def _missing(runtime: Runtime) -> list[str]:
    return [package for package in runtime.packages if importlib.util.find_spec(package) is None]


def _does_not_fit(config: EncoderConfig, path: Path, suffixes: Sequence[str]) -> str:
    backends = [name for name, runtime in RUNTIMES.items() if runtime.suffix == path.suffix]
    if backends:
        return (
            f'parameter encoder.backend: expected one of auto, {", ".join(backends)} for {config.weights}, '
            f'got {config.backend!r}'
        )
    expected = ' or '.join(dict.fromkeys(suffixes))
    return f'parameter encoder.weights: {config.name} needs a {expected} file, got {config.weights!r}'
