"""Frozen records to and from YAML and JSON, strictly: every key is a field of the record and has its type.

A record is a frozen dataclass whose fields are text, numbers, booleans, other records, tuples and mappings of these, or
optional ones. Types are strict: true is not a number, 1 is also a float, a float is finite, 1.0 is not an integer. A
field's metadata may hold ``bounds``, with a method ``problem(value)`` that says why a value is not allowed. A condition
on several fields is checked by the record itself (``__post_init__`` raises ConfigError).
"""

from __future__ import annotations

import collections.abc
import dataclasses
import difflib
import functools
import json
import math
import re
import reprlib
import typing
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NewType, TypeVar

import cattrs
import yaml
from cattrs.errors import BaseValidationError, ForbiddenExtraKeysError
from cattrs.gen import make_dict_structure_fn

from offradar_ros.bounded_input import add_float_resolver, parse_json, parse_yaml, read_text
from offradar_ros.errors import ConfigError, OffradarError
from offradar_ros.whole_file import require_replaceable, write_whole_file
from offradar_ros.yaml_digest import AlteredError, check_digest

RecordT = TypeVar('RecordT')

if TYPE_CHECKING:
    Measure = float
else:
    # A distinct type marks the floats of a record that may be NaN. For the type checker it is a float.
    Measure = NewType('Measure', float)
    """A float that is NaN where it could not be measured; NaN and infinity are null in files."""

_EXPECTED = {str: 'text', int: 'a whole number', float: 'a finite number', bool: 'true or false'}
_LOCATION = re.compile(r'@ (?:attribute (?P<name>\w+)|index (?P<index>\d+)|key (?P<quoted>.+))$', re.DOTALL)
"""The end of a note in which cattrs gives the location of an error in a tree."""
_LONGEST_REASON = 1000
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 200


def structure(kind: type[RecordT], tree: Any, noun: str = 'key') -> RecordT:
    """The record of type `kind` in a tree of plain values; keys with a default may be missing.

    ConfigError is one line: `noun` and the dotted key, and what was expected.
    """
    try:
        return _CONVERTER.structure(tree, kind)
    except (BaseValidationError, ValueError) as error:
        raise ConfigError(_shortened(_reason(error, '', noun))) from None


def unstructure(record: Any) -> Any:
    """The tree of plain values that `structure` reads: dicts, lists, text and numbers."""
    return _CONVERTER.unstructure(record)


def replace(record: RecordT, values: Mapping[str, Any], noun: str = 'key', fallback_hint: str = '') -> RecordT:
    """A copy of `record` with new values for dotted names; the record is checked after all are set.

    ConfigError names the first unknown or invalid name; `fallback_hint` is added where no known name is similar.
    """
    tree = unstructure(record)
    known = flatten(tree)
    for name, value in values.items():
        if name not in known:
            raise ConfigError(_unknown(noun, '', name, sorted(known), fallback_hint))
        *branches, leaf = name.split('.')
        branch = tree
        for key in branches:
            branch = branch[key]
        branch[leaf] = value
    return structure(type(record), tree, noun)


def flatten(tree: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """A tree of mappings as one dict with dotted names; ConfigError where one is there with dots and as a tree."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        found = flatten(value, f'{prefix}{key}.') if isinstance(value, Mapping) else {f'{prefix}{key}': value}
        for name in flat.keys() & found.keys():
            raise ConfigError(f'{name} is there twice, with dots and as a mapping')
        flat |= found
    return flat


def read_record(kind: type[RecordT], path: str | Path) -> RecordT:
    """The record that a YAML or JSON file holds; ConfigError names the file, the key and what was expected."""
    tree = read_tree(path)
    try:
        return structure(kind, tree)
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from None


def write_record(path: str | Path, record: Any) -> None:
    """Write a record for `read_record`, atomically: JSON if `path` ends in .json, YAML otherwise."""
    text = to_json(record) if Path(path).suffix == '.json' else to_yaml(record)
    try:
        write_whole_file(path, text.encode())
    except OSError as error:
        raise ConfigError(f'{path}: cannot be written ({error.strerror})') from error


def require_writable(path: Path, like: bytes | None = b'') -> None:
    """ConfigError where a file that begins as `like`, by default text, could not be written whole; None for any file.

    A file that is there is not changed, and none is left where there was none.
    """
    try:
        require_replaceable(path, like)
    except OSError as error:
        raise ConfigError(f'{path}: cannot be written ({error.strerror})') from error


def read_tree(path: str | Path) -> Any:
    """The content of a YAML or JSON file, as plain types.

    ConfigError if it cannot be read, or has a digest (`yaml_digest`) of other values.
    """
    is_json = Path(path).suffix == '.json'
    try:
        text = read_text(path)
        if is_json:
            return parse_json(text)
        tree = parse_yaml(text)
        check_digest(text, tree)
        return tree
    except FileNotFoundError:
        raise ConfigError(f'{path}: no such file') from None
    except AlteredError as error:
        raise ConfigError(f'{path}: {error}') from None
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(
            f'{path}: not a readable {"JSON" if is_json else "YAML"} file ({_unreadable(error)})'
        ) from error


def to_yaml(record: Any) -> str:
    """A record or a tree as YAML that `parse_yaml` reads, keys in their order."""
    return yaml.dump(unstructure(record), Dumper=_Dumper, sort_keys=False)


def to_json(record: Any) -> str:
    """A record or a tree as JSON, keys in their order; ValueError for NaN and infinity, which JSON does not have."""
    return json.dumps(unstructure(record), indent=1, allow_nan=False) + '\n'


class _Dumper(yaml.SafeDumper):
    pass


add_float_resolver(_Dumper)


def _unreadable(error: Exception) -> str:
    if isinstance(error, UnicodeDecodeError):
        return 'expected UTF-8 text'
    # The first line of its text says where the parser was in the document, but not what is wrong.
    if isinstance(error, yaml.MarkedYAMLError) and error.problem and error.problem_mark:
        return _shortened(f'line {error.problem_mark.line + 1}: {error.problem}')
    return _shortened((getattr(error, 'strerror', None) or str(error)).splitlines()[0])


def _scalar(value: Any, kind: Any) -> Any:
    if kind is float and type(value) is int and value.bit_length() < 1024:
        value = float(value)
    if type(value) is not kind or (kind is float and not math.isfinite(value)):
        raise ValueError(f'expected {_EXPECTED[kind]}, got {_shown(value)}')
    return value


def _measure(value: Any, _: Any) -> float:
    number: float = math.nan if value is None else _scalar(value, float)
    return number


def _tuple(value: Any, kind: Any) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ValueError(f'expected a list, got {_shown(value)}')
    items: Any = list[typing.get_args(kind)[0]]  # type: ignore[misc]
    return tuple(_CONVERTER.structure(value, items))


def _mapping(value: Any, kind: Any) -> dict[Any, Any]:
    if not isinstance(value, Mapping):
        raise ValueError(f'expected a mapping of keys, got {type(value).__name__}')
    items: Any = dict[typing.get_args(kind)]  # type: ignore[misc]
    structured: dict[Any, Any] = _CONVERTER.structure(value, items)
    return structured


def _record_hook(kind: Any) -> Callable[[Any, Any], Any]:
    fields = make_dict_structure_fn(kind, _CONVERTER, _cattrs_forbid_extra_keys=True)
    bounds = {f.name: f.metadata['bounds'] for f in dataclasses.fields(kind) if 'bounds' in f.metadata}

    def hook(tree: Any, _: Any) -> Any:
        if not isinstance(tree, Mapping):
            raise ValueError(f'expected a mapping of keys, got {type(tree).__name__}')
        named = {str(name): value for name, value in tree.items()}
        for name, bound in bounds.items():
            problem = bound.problem(named[name]) if name in named else None
            if problem:
                raise _BoundsError(name, problem)
        return fields(named, kind)

    return hook


class _BoundsError(ValueError):
    """The value of a field is outside its bounds."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(problem)
        self.name = name


def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(unstruct_collection_overrides={tuple: list})
    for kind in _EXPECTED:
        converter.register_structure_hook(kind, _scalar)
    converter.register_structure_hook_func(_is_measure, _measure)
    converter.register_unstructure_hook_func(_is_measure, lambda value: value if math.isfinite(value) else None)
    for origin, hook in ((tuple, _tuple), (collections.abc.Mapping, _mapping)):
        converter.register_structure_hook_func(functools.partial(_is_of, origin), hook)
    converter.register_structure_hook_factory(dataclasses.is_dataclass, _record_hook)
    return converter


def _is_measure(kind: Any) -> bool:
    return kind is Measure


def _is_of(origin: Any, kind: Any) -> bool:
    return typing.get_origin(kind) is origin


_CONVERTER = _converter()


def _reason(error: BaseException, key: str, noun: str) -> str:
    """One line about the first error within `error`, which occurred at the dotted `key`."""
    if isinstance(error, BaseValidationError):
        first = next((e for e in error.exceptions if isinstance(e, ForbiddenExtraKeysError)), error.exceptions[0])
        return _reason(first, _located(key, getattr(first, '__notes__', ())), noun)
    # The message of a record names its fields already.
    if isinstance(error, OffradarError):
        return str(error)
    if isinstance(error, ForbiddenExtraKeysError):
        known = [field.name for field in dataclasses.fields(error.cl)]
        return _unknown(noun, key, min(error.extra_fields), known)
    if isinstance(error, KeyError):
        return f'{noun} {key} is missing'
    if isinstance(error, _BoundsError):
        key = f'{key}.{error.name}'.lstrip('.')
    return f'{noun} {key}: {error}' if key else str(error)


def _located(key: str, notes: Iterable[str]) -> str:
    for note in notes:
        found = _LOCATION.search(note)
        if found and found['name']:
            return f'{key}.{found["name"]}'.lstrip('.')
        if found:
            return f'{key}[{found["index"] or found["quoted"]}]'
    return key


def _unknown(noun: str, within: str, name: str, known: Iterable[str], fallback_hint: str = '') -> str:
    shown = f'{within}.{name}'.lstrip('.') if within else name
    nearest = difflib.get_close_matches(name, known, 1)
    hint = f'did you mean {nearest[0]}?' if nearest else fallback_hint
    return f'{noun} {shown if shown.isprintable() else repr(shown)} is unknown' + (f': {hint}' if hint else '')


def _shown(value: Any) -> str:
    # Not repr: that of a large tree is a text many times as large.
    return _SHORT.repr(value)


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST_REASON else f'{text[:_LONGEST_REASON]}…'
