"""Training configurations from YAML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from offradar_ros.bounded_input import parse_yaml
from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.records import flatten, read_tree, replace


def read_config(path: str | Path, settings: Sequence[str] = ()) -> TrainingConfig:
    """The configuration of a YAML file, changed by ``KEY=VALUE`` settings; ConfigError names the file and the key."""
    tree = read_tree(path)
    if not isinstance(tree, Mapping):
        raise ConfigError(f'{path}: expected a mapping of keys, got {type(tree).__name__}')
    config = with_values(TrainingConfig(), flatten(tree), str(path))
    return with_values(config, dict(_setting(text) for text in settings), '--set')


def with_values(config: TrainingConfig, values: Mapping[str, Any], source: str) -> TrainingConfig:
    """A copy of `config` with dotted keys set; ConfigError names `source` and the first unknown or invalid key."""
    try:
        return replace(config, values)
    except ConfigError as error:
        raise ConfigError(f'{source}: {error}') from None


def _setting(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition('=')
    if not equals or not key:
        raise ConfigError(f'--set {text!r}: expected KEY=VALUE')
    try:
        return key.strip(), parse_yaml(value)
    except (ValueError, yaml.YAMLError):
        raise ConfigError(f'--set {text!r}: the value is not readable as YAML') from None
