"""Training configurations to and from YAML."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from offradar_ros.config import Bounds, flatten
from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.yaml_record import read_tree


def read_config(path: str | Path, settings: Sequence[str] = ()) -> TrainingConfig:
    """The configuration of a YAML file, changed by ``KEY=VALUE`` settings; ConfigError names the file and the key."""
    tree = read_tree(path)
    if not isinstance(tree, Mapping):
        raise ConfigError(f'{path}: expected a mapping of keys, got {type(tree).__name__}')
    config = with_values(TrainingConfig(), flatten(tree), str(path))
    return with_values(config, dict(_setting(text) for text in settings), '--set')


def with_values(config: TrainingConfig, values: Mapping[str, Any], source: str) -> TrainingConfig:
    """A copy of `config` with dotted keys set; ConfigError names `source` and the first unknown or invalid key."""
    known = dict(_leaves(config, ''))
    for key in values:
        if key not in known:
            nearest = difflib.get_close_matches(str(key), known, 1)
            hint = f': did you mean {nearest[0]}?' if nearest else ''
            raise ConfigError(f'{source}: key {str(key)!r} is unknown{hint}')
    checked = {key: _checked(f'{source}: key {key}', value, *known[key]) for key, value in values.items()}
    try:
        rebuilt: TrainingConfig = _rebuilt(config, checked, '')
    except ConfigError as error:
        raise ConfigError(f'{source}: {error}') from None
    return rebuilt


def to_yaml(config: TrainingConfig) -> str:
    """Every key with its value, as `read_config` reads it."""
    return yaml.safe_dump(_plain(dataclasses.asdict(config)), sort_keys=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    return list(value) if isinstance(value, tuple) else value


def _setting(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition('=')
    if not equals or not key:
        raise ConfigError(f'--set {text!r}: expected KEY=VALUE')
    try:
        return key.strip(), yaml.safe_load(value)
    except (ValueError, yaml.YAMLError):
        raise ConfigError(f'--set {text!r}: the value is not readable as YAML') from None


def _leaves(config: Any, prefix: str) -> list[tuple[str, tuple[Any, Bounds | None]]]:
    found: list[tuple[str, tuple[Any, Bounds | None]]] = []
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            found += _leaves(value, f'{prefix}{field.name}.')
        else:
            found.append((prefix + field.name, (value, field.metadata.get('bounds'))))
    return found


def _checked(key: str, value: Any, default: Any, bounds: Bounds | None) -> Any:
    if isinstance(default, tuple):
        if not isinstance(value, (list, tuple)) or not all(isinstance(item, str) for item in value):
            raise ConfigError(f'{key}: expected a list of texts, got {value!r}')
        return tuple(value)
    if isinstance(default, float):
        value = _number(value)
    if type(value) is not type(default):
        raise ConfigError(f'{key}: expected {type(default).__name__}, got {value!r}')
    problem = bounds.problem(value) if bounds else None
    if problem:
        raise ConfigError(f'{key}: {problem}')
    return value


def _number(value: Any) -> Any:
    """YAML 1.1 reads 1e-5 as text and 1 as an integer; both are meant as numbers here."""
    if isinstance(value, bool) or not isinstance(value, (int, str)):
        return value
    try:
        return float(value)
    except (ValueError, OverflowError):
        return value


def _rebuilt(config: Any, values: Mapping[str, Any], prefix: str) -> Any:
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(config):
        value, key = getattr(config, field.name), prefix + field.name
        if dataclasses.is_dataclass(value):
            changes[field.name] = _rebuilt(value, values, key + '.')
        elif key in values:
            changes[field.name] = values[key]
    return dataclasses.replace(config, **changes)
