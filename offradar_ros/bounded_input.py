"""Reads files and texts of unknown origin within bounds: no size, depth or alias can exhaust memory or time."""

from __future__ import annotations

import errno
import json
import os
import re
import stat
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from yaml.constructor import ConstructorError

MAX_TEXT_BYTES = 4 * 1024**2
"""Longest parameter file, protocol or other text that people write."""
MAX_DEPTH = 64
"""Deepest nesting of YAML and JSON."""
MAX_YAML_NODES = 50_000
"""Most keys and values of a YAML text, each alias counted with all that it stands for.

PyYAML reads some 10,000 of them in a second. The description of a bag of 3000 files has as many.
"""
_LONGEST_NUMBER = 400
_LONGEST_KEY = 60
_MAX_YAML_EXPANDED = 4 * MAX_TEXT_BYTES


def read_bounded(path: str | Path, limit_bytes: int) -> bytes:
    """Content of a regular file of at most `limit_bytes`.

    OSError, whose `strerror` says why, for a file that is missing, unreadable or larger, and for a folder, a device or
    a FIFO, which is not waited for.
    """
    # Without O_NONBLOCK, a FIFO would not even open before somebody writes to it.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, 'Not a regular file', str(path))
        with os.fdopen(descriptor, 'rb', closefd=False) as file:
            # It may grow between the two looks at its size.
            content = file.read(limit_bytes + 1) if status.st_size <= limit_bytes else b''
        if status.st_size > limit_bytes or len(content) > limit_bytes:
            raise OSError(errno.EFBIG, f'Larger than {limit_bytes} bytes', str(path))
    finally:
        os.close(descriptor)
    return content


def read_text(path: str | Path, limit_bytes: int = MAX_TEXT_BYTES) -> str:
    """UTF-8 text of a file, as `read_bounded`; ValueError if it is not UTF-8."""
    return read_bounded(path, limit_bytes).decode('utf-8')


def parse_json(text: str | bytes, limit_bytes: int = MAX_TEXT_BYTES) -> Any:
    """JSON text to plain values.

    ValueError if it is not JSON, too long or too deep, or if a key stands twice in one object: one of its values would
    be lost.
    """
    _require_short(len(text), limit_bytes)
    try:
        tree = json.loads(text, object_pairs_hook=_object)
    except RecursionError:
        raise ValueError(f'nested deeper than {MAX_DEPTH} levels') from None
    _require_shallow(tree)
    return tree


def parse_yaml(text: str, limit_bytes: int = MAX_TEXT_BYTES) -> Any:
    """YAML text to plain values; as in YAML 1.2 and in ROS, 1e-5 is a number.

    yaml.YAMLError or ValueError if it is not YAML, too long or too deep, if its aliases stand for too much, or if a key
    stands twice in one mapping, be it as 1 and as 0x1: one of its values would be lost.
    """
    _require_short(len(text), limit_bytes)
    try:
        return yaml.load(text, _Loader)
    except RecursionError:
        raise ValueError(f'nested deeper than {MAX_DEPTH} levels') from None


def _require_short(length: int, limit_bytes: int) -> None:
    if length > limit_bytes:
        raise ValueError(f'longer than {limit_bytes} bytes')


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f'{key[:_LONGEST_KEY]!a} is there twice in one object')
        found[key] = value
    return found


def _require_shallow(tree: Any) -> None:
    level = [tree]
    for _ in range(MAX_DEPTH + 1):
        branches = [value for value in level if isinstance(value, (dict, list))]
        level = [item for value in branches for item in (value.values() if isinstance(value, dict) else value)]
        if not level:
            return
    raise ValueError(f'nested deeper than {MAX_DEPTH} levels')


def add_float_resolver(kind: Any) -> None:
    """Teach a loader or dumper of PyYAML that 1e-5 is a number.

    PyYAML follows YAML 1.1, where a number with an exponent needs a decimal point and a signed exponent.
    """
    kind.add_implicit_resolver(
        'tag:yaml.org,2002:float', re.compile(r'[-+]?(?:\d+(?:\.\d*)?|\.\d+)[eE][-+]?\d+$'), list('-+.0123456789')
    )


_MERGE_OR_DEFAULT = ('tag:yaml.org,2002:merge', 'tag:yaml.org,2002:value')
"""Tags of << and =, which are keys but no values."""


class _Size(NamedTuple):
    """What a node holds, each alias counted with all that it stands for; its height is that of the tree below it."""

    nodes: int
    characters: int
    height: int


class _Loader(yaml.SafeLoader):
    """Refuses a text as soon as what was read of it is beyond the bounds."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._nodes = 0
        self._characters = 0
        self._depth = -1
        self._deepest = 0
        self._sizes: dict[int, _Size] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """As in SafeLoader, and counted."""
        is_alias = self.check_event(yaml.AliasEvent)
        nodes, characters, deepest = self._nodes, self._characters, self._deepest
        self._depth += 1
        self._deepest = self._depth
        self._require_within(0 if is_alias else 1, 0, 0)
        node: yaml.Node | None = super().compose_node(parent, index)
        if is_alias:
            if id(node) not in self._sizes:
                raise ValueError('an alias stands inside its own anchor')
            self._require_within(*self._sizes[id(node)])
        else:
            if isinstance(node, yaml.ScalarNode):
                self._require_within(0, len(node.value), 0)
            self._sizes[id(node)] = _Size(
                self._nodes - nodes, self._characters - characters, self._deepest - self._depth
            )
        self._deepest = max(self._deepest, deepest)
        self._depth -= 1
        return node

    def _require_within(self, nodes: int, characters: int, height: int) -> None:
        """Count what is found at the present depth; ValueError beyond the bounds."""
        self._nodes += nodes
        self._characters += characters
        self._deepest = max(self._deepest, self._depth + height)
        if self._nodes > MAX_YAML_NODES or self._characters > _MAX_YAML_EXPANDED:
            raise ValueError(f'holds or repeats by aliases more than {MAX_YAML_NODES} values')
        if self._deepest > MAX_DEPTH:
            raise ValueError(f'nested deeper than {MAX_DEPTH} levels')

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """As in SafeLoader; ValueError for keys that are equal."""
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        found: dict[Any, yaml.ScalarNode] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                value = key.tag if key.tag in _MERGE_OR_DEFAULT else self.construct_object(key)
                if value in found:
                    raise ValueError(_there_twice(found[value], key))
                found[value] = key
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:  # noqa: ARG002 - always deep.
        """As in SafeLoader, but ConstructorError for whatever its tag, be it a wrong one, says that it is not."""
        kind, value = node.tag.rpartition(':')[2], node.value
        if kind in ('int', 'float') and len(value) > _LONGEST_NUMBER:
            # 1:1:1:…, which is a number of base 60, would take hours.
            raise ConstructorError(None, None, f'number of over {_LONGEST_NUMBER} digits', node.start_mark)
        try:
            return super().construct_object(node, deep=True)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            shown = ascii(value[:_LONGEST_KEY]) if isinstance(value, str) else 'what stands here'
            raise ConstructorError(None, None, f'{shown} is no {kind}', node.start_mark) from error


def _there_twice(first: yaml.ScalarNode, second: yaml.ScalarNode) -> str:
    name, first_name = (ascii(key.value[:_LONGEST_KEY]) for key in (second, first))
    text = f'line {second.start_mark.line + 1}: {name} is there twice, first in line {first.start_mark.line + 1}'
    return text if name == first_name else f'{text}, as {first_name}'


add_float_resolver(_Loader)
