"""Encoders of other installed packages: entry points of the group ``offradar_ros.encoders``.

The name of an entry point is a value of `encoder.name` and of ``evaluate --method``. Its object, a class or a function,
is called with the `EncoderConfig` and returns an `Encoder`.
"""

from __future__ import annotations

import dataclasses
import importlib.metadata

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.model_files import first_line
from offradar_ros.encoders.protocol import Encoder, ModelInfo
from offradar_ros.errors import ConfigError, ModelError, OffradarError

GROUP = 'offradar_ros.encoders'


def installed_names() -> tuple[str, ...]:
    """Sorted names of the encoders that other packages offer; no package is imported."""
    return tuple(sorted(importlib.metadata.entry_points(group=GROUP).names))


def make_installed(config: EncoderConfig) -> Encoder:
    """The encoder that another package offers as `config.name`, one of `installed_names`.

    Its factory gets `config`, with empty `weights` if the parameter has its default, the name of weights of this
    package. ModelError if the package cannot be imported or raises an error; an `OffradarError` passes through.
    ConfigError if the object is not an encoder, and if two packages offer the name.
    """
    found = list(importlib.metadata.entry_points(group=GROUP, name=config.name))
    packages = sorted({point.dist.name if point.dist else point.value for point in found})
    if len(packages) > 1:
        offered = ' and '.join(packages)
        raise ConfigError(f'parameter encoder.name: {config.name} is offered by {offered}: uninstall one')
    where = f'encoder {config.name} of the package {packages[0]} ({found[0].value})'
    if config.weights == EncoderConfig.weights:
        config = dataclasses.replace(config, weights='')
    try:
        encoder = found[0].load()(config)
        if isinstance(encoder, Encoder) and isinstance(encoder.info, ModelInfo):
            return encoder
    except OffradarError:
        raise
    except Exception as error:  # any error of the other package
        raise ModelError(f'{where}: cannot be made: {type(error).__name__}: {first_line(error)}') from error
    raise ConfigError(f'{where}: expected an Encoder (info, runs_on, encode), got {type(encoder).__name__}')
