"""Every encoder by name. Runtimes are imported by the factory that needs one, so that a node loads no other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.model_files import require_package
from offradar_ros.encoders.network_config import METHODS
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.rad_vlad import RadVladEncoder
from offradar_ros.encoders.rad_vlad_codebook import load_codebook
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import ConfigError

BACKENDS = {'.onnx': 'onnx', '.safetensors': 'torch'}


def make_encoder(config: EncoderConfig) -> Encoder:
    """The encoder that `config` names; ConfigError for settings that do not fit, ModelError for unusable weights."""
    if config.name not in ENCODERS:
        raise ConfigError(f'parameter encoder.name: expected one of {", ".join(ENCODERS)}, got {config.name!r}')
    return ENCODERS[config.name](config)


def _ring_key(config: EncoderConfig) -> Encoder:
    return RingKeyEncoder(config.ring_key)


def _rad_vlad(config: EncoderConfig) -> Encoder:
    return RadVladEncoder(load_codebook(_weights(config, ('.safetensors',))))


def _learned(config: EncoderConfig) -> Encoder:
    suffixes = tuple(suffix for suffix, backend in BACKENDS.items() if config.backend in ('auto', backend))
    path = _weights(config, suffixes)
    if BACKENDS[path.suffix] == 'onnx':
        require_package('onnxruntime', path)
        from offradar_ros.encoders.onnx_backend import OnnxEncoder  # noqa: PLC0415

        encoder: Encoder = OnnxEncoder(path, config.threads, config.device)
    else:
        for package in ('torch', 'safetensors'):
            require_package(package, path)
        from offradar_ros.encoders.torch_backend import TorchEncoder  # noqa: PLC0415

        encoder = TorchEncoder(path, config.threads, config.device)
    if encoder.info.name != config.name:
        raise ConfigError(
            f'parameter encoder.name: {config.weights} holds a network of {encoder.info.name}, got {config.name!r}'
        )
    return encoder


def _weights(config: EncoderConfig, suffixes: tuple[str, ...]) -> Path:
    """The weights file that `config` names, of one of the endings; ConfigError where it names none."""
    path = find_weights(config.weights, suffixes)
    if path.suffix in suffixes:
        return path
    if path.suffix in BACKENDS and config.name != 'rad_vlad':
        backend = BACKENDS[path.suffix]
        raise ConfigError(
            f'parameter encoder.backend: {config.weights} is for the {backend} backend, got {config.backend!r}'
        )
    raise ConfigError(
        f'parameter encoder.weights: {config.name} needs a {" or ".join(suffixes)} file, got {config.weights!r}'
    )


ENCODERS: dict[str, Callable[[EncoderConfig], Encoder]] = {
    'ring_key': _ring_key,
    'rad_vlad': _rad_vlad,
    **dict.fromkeys(METHODS, _learned),
}
