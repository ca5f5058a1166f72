"""Every encoder by name. Runtimes are imported by the factory that needs one, so that a node loads no other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.model_files import require_package
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import ConfigError

SUFFIXES = {'.onnx': 'onnx', '.safetensors': 'torch'}


def make_encoder(config: EncoderConfig) -> Encoder:
    """The encoder that `config` names; ConfigError for settings that do not fit, ModelError for unusable weights."""
    if config.name not in ENCODERS:
        raise ConfigError(f'parameter encoder.name: expected one of {", ".join(ENCODERS)}, got {config.name!r}')
    return ENCODERS[config.name](config)


def _ring_key(config: EncoderConfig) -> Encoder:
    return RingKeyEncoder(config.ring_key)


def _variational(config: EncoderConfig) -> Encoder:
    if not config.weights:
        raise ConfigError(
            'parameter encoder.weights: expected a .onnx or .safetensors file for the variational encoder'
        )
    suffix = Path(config.weights).suffix
    if suffix not in SUFFIXES:
        raise ConfigError(f'parameter encoder.weights: expected a .onnx or .safetensors file, got {config.weights!r}')
    backend = SUFFIXES[suffix]
    if config.backend not in ('auto', backend):
        raise ConfigError(
            f'parameter encoder.backend: {config.weights} is for the {backend} backend, got {config.backend!r}'
        )
    if backend == 'onnx':
        require_package('onnxruntime', config.weights)
        from offradar_ros.encoders.onnx_backend import OnnxEncoder  # noqa: PLC0415

        return OnnxEncoder(config.weights, config.threads)
    for package in ('torch', 'safetensors'):
        require_package(package, config.weights)
    from offradar_ros.encoders.torch_backend import TorchEncoder  # noqa: PLC0415

    return TorchEncoder(config.weights, config.threads)


ENCODERS: dict[str, Callable[[EncoderConfig], Encoder]] = {'ring_key': _ring_key, 'variational': _variational}
