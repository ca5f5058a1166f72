"""Reads files and texts of unknown origin within bounds: no size, depth or alias can exhaust memory or time."""

from __future__ import annotations

import errno
import json
import os
import re
import stat
from pathlib import Path
from typing import Any

import yaml

MAX_TEXT_BYTES = 4 * 1024**2
"""Longest parameter file, protocol or other text that people write."""
MAX_DEPTH = 64
"""Deepest nesting of YAML and JSON."""
MAX_YAML_NODES = 200_000
"""Most values of a YAML text, each alias counted with all that it stands for."""
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
    """JSON text to plain values; ValueError if it is not JSON, too long or too deep."""
    _require_short(len(text), limit_bytes)
    try:
        tree = json.loads(text)
    except RecursionError:
        raise ValueError(f'nested deeper than {MAX_DEPTH} levels') from None
    _require_shallow(tree)
    return tree


def parse_yaml(text: str, limit_bytes: int = MAX_TEXT_BYTES) -> Any:
    """YAML text to plain values; as in YAML 1.2 and in ROS, 1e-5 is a number.

    yaml.YAMLError or ValueError if it is not YAML, too long or too deep, if its aliases stand for too much, or if a key
    stands twice in one mapping: one of its values would be lost.
    """
    _require_short(len(text), limit_bytes)
    try:
        return yaml.load(text, _Loader)
    except RecursionError:
        raise ValueError(f'nested deeper than {MAX_DEPTH} levels') from None


def _require_short(length: int, limit_bytes: int) -> None:
    if length > limit_bytes:
        raise ValueError(f'longer than {limit_bytes} bytes')


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
        'tag:yaml.org,2002:float', re.compile(r'[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$'), list('-+.0123456789')
    )


class _Loader(yaml.SafeLoader):
    def compose_document(self) -> yaml.Node | None:
        root: yaml.Node | None = super().compose_document()
        if root is not None:
            _Expansion().measure(root, 0)
        return root

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:  # noqa: ARG002 - always deep.
        """As in SafeLoader, but an alias inside its own anchor, an infinite tree, is refused."""
        return super().construct_object(node, deep=True)


add_float_resolver(_Loader)


def _require_distinct_keys(node: yaml.Node) -> None:
    if not isinstance(node, yaml.MappingNode):
        return
    found: dict[tuple[str, str], int] = {}
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            line = key.start_mark.line + 1
            if (key.tag, key.value) in found:
                name, first = ascii(key.value[:_LONGEST_KEY]), found[key.tag, key.value]
                raise ValueError(f'line {line}: {name} is there twice, first in line {first}')
            found[key.tag, key.value] = line


class _Expansion:
    """Nodes and characters that a YAML tree has when each alias is replaced by what it stands for."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[int, int, int]] = {}
        self._open: set[int] = set()

    def measure(self, node: yaml.Node, depth: int) -> tuple[int, int, int]:
        """Nodes, characters and height of a node; ValueError beyond the bounds."""
        if depth > MAX_DEPTH:
            raise ValueError(f'nested deeper than {MAX_DEPTH} levels')
        if isinstance(node, yaml.ScalarNode):
            return 1, len(node.value), 0
        if id(node) in self._open:
            raise ValueError('an alias stands inside its own anchor')
        if id(node) not in self._known:
            self._open.add(id(node))
            _require_distinct_keys(node)
            nodes, characters, height = 1, 0, 0
            parts = (
                node.value if isinstance(node, yaml.SequenceNode) else [part for pair in node.value for part in pair]
            )
            for part in parts:
                more_nodes, more_characters, below = self.measure(part, depth + 1)
                nodes, characters, height = nodes + more_nodes, characters + more_characters, max(height, below + 1)
            self._known[id(node)] = nodes, characters, height
            self._open.discard(id(node))
        nodes, characters, height = self._known[id(node)]
        if nodes > MAX_YAML_NODES or characters > _MAX_YAML_EXPANDED:
            raise ValueError(f'holds or repeats by aliases more than {MAX_YAML_NODES} values')
        if depth + height > MAX_DEPTH:
            raise ValueError(f'nested deeper than {MAX_DEPTH} levels')
        return nodes, characters, height
