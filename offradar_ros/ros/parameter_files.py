"""Parameter files on a command line: readable, and for the node that is given them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import yaml

from offradar_ros.bounded_input import parse_yaml, read_text
from offradar_ros.errors import ConfigError
from offradar_ros.yaml_digest import AlteredError, check_digest

_OPTION = '--params-file'
_VALUES = 'ros__parameters'


def check_parameter_files(argv: Sequence[str]) -> None:
    """ConfigError for a `--params-file` that is missing, not a file, not YAML of node names and parameters, or
    of other values than those of its digest.

    ROS would wait for ever for a FIFO, and says less about the others.
    """
    for path in _parameter_files(argv):
        _read(path)


def not_addressed(argv: Sequence[str], node: str) -> list[str]:
    """One line for each `--params-file` in which nothing is for the node of this full name."""
    found = []
    for path in _parameter_files(argv):
        patterns = sorted(set(_patterns(_read(path))))
        if not any(_matches(pattern, node) for pattern in patterns):
            found.append(
                f'{path}: has no parameters for {node}, only for {", ".join(patterns) or "no node at all"}: '
                'none of it is used'
            )
    return found


def _parameter_files(argv: Sequence[str]) -> Iterator[str]:
    for_ros = False
    for argument, value in zip(argv, [*argv[1:], ''], strict=False):
        if argument == '--ros-args':
            for_ros = True
        elif argument == '--':
            for_ros = False
        elif for_ros and argument == _OPTION and value:
            yield value


def _read(path: str) -> dict[str, Any]:
    try:
        text = read_text(path)
        tree = parse_yaml(text)
        check_digest(text, tree)
    except AlteredError as error:
        raise ConfigError(f'{_OPTION} {path}: {error}') from error
    except OSError as error:
        raise ConfigError(f'{_OPTION} {path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigError(f'{_OPTION} {path}: not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(tree, dict) or not all(isinstance(key, str) for key in tree):
        raise ConfigError(f'{_OPTION} {path}: expected names of nodes, or /**, and `{_VALUES}` below each')
    return tree


def _patterns(tree: dict[str, Any], above: str = '') -> Iterator[str]:
    """The names of nodes in a file, as ROS matches them: absolute, with wildcards."""
    for key, value in tree.items():
        name = f'{above}/{str(key).strip("/")}'
        if isinstance(value, dict):
            if _VALUES in value:
                yield name
            yield from _patterns({k: v for k, v in value.items() if k != _VALUES}, name)


def _matches(pattern: str, node: str) -> bool:
    """Whether a name with wildcards is that of a node: * stands for one part, ** for any number of them."""
    wildcards = {'*': '/[^/]+', '**': '(/[^/]+)*'}
    parts = [wildcards.get(part, f'/{re.escape(part)}') for part in pattern.strip('/').split('/')]
    return re.fullmatch(''.join(parts), node) is not None
