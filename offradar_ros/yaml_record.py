"""Frozen records from YAML: every key is a field of a record, of its type; nothing is guessed."""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml

from offradar_ros.errors import ConfigError

RecordT = TypeVar('RecordT')
WORDS = {str: 'text', int: 'a whole number', float: 'a finite number', bool: 'true or false'}


def read_record(kind: type[RecordT], path: str | Path) -> RecordT:
    """The dataclass that a YAML file holds; ConfigError names the file, the key and what was expected."""
    tree = read_tree(path)
    try:
        record: RecordT = _record(kind, tree, '')
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None
    return record


def read_tree(path: str | Path) -> Any:
    """What a YAML file holds, of plain types; ConfigError where it cannot be read."""
    try:
        return yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except FileNotFoundError:
        raise ConfigError(f'{path}: no such file') from None
    # ValueError: PyYAML on a date such as 2001-99-99; RecursionError: an alias inside its own anchor.
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        reason = (getattr(error, 'strerror', None) or str(error)).splitlines()[0]
        raise ConfigError(f'{path}: not a readable YAML file ({reason})') from error


def _record(kind: Any, tree: Any, key: str) -> Any:
    if not isinstance(tree, Mapping):
        raise ConfigError(f'{key or "file"}: expected a mapping of keys, got {type(tree).__name__}')
    types = typing.get_type_hints(kind)
    for name in tree:
        if name not in types:
            nearest = difflib.get_close_matches(str(name), types, 1)
            hint = f': did you mean {nearest[0]}?' if nearest else ''
            raise ConfigError(f'key {_inner(key, str(name))} is unknown{hint}')
    for field in dataclasses.fields(kind):
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and field.name not in tree:
            raise ConfigError(f'key {_inner(key, field.name)} is missing')
    return kind(**{name: _value(types[name], value, _inner(key, name)) for name, value in tree.items()})


def _value(kind: Any, value: Any, key: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return _record(kind, value, key)
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise ConfigError(f'key {key}: expected a list, got {value!r}')
        (item_kind, _) = typing.get_args(kind)
        return tuple(_value(item_kind, item, f'{key}[{number}]') for number, item in enumerate(value))
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind or (kind is float and not math.isfinite(value)):
        raise ConfigError(f'key {key}: expected {WORDS[kind]}, got {value!r}')
    return value


def _inner(key: str, name: str) -> str:
    return f'{key}.{name}' if key else name
