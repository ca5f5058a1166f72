"""Outputs that are inputs, too: the recording, map or weights that a command reads would be lost."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from offradar_ros.errors import ConfigError

OUTPUTS = frozenset({'out', 'plot'})
"""Names of the options and arguments that say what is written."""
_KEPT = {'calibrate': 'params'}
"""What a command may write again, since it keeps what was there."""


def require_other_outputs(command: str, options: dict[str, Any]) -> None:
    """ConfigError for a file that a command reads and would replace."""
    for name, path in _paths(options):
        if name not in OUTPUTS or not path.is_file():
            continue
        for other, read in _paths(options):
            if other not in OUTPUTS and other != _KEPT.get(command) and _is_same(path, read):
                raise ConfigError(f'{path}: the command reads it, and would replace it: give the output another name')


def require_beside(source: Path, out: Path) -> None:
    """ConfigError for a folder to write that is the source, holds it or lies in it."""
    read, written = source.resolve(), out.resolve()
    if read.is_relative_to(written):
        raise ConfigError(f'{out}: is the source, or holds it, and would replace it: expected another folder')
    if written.is_relative_to(read) and read.is_dir():
        raise ConfigError(f'{out}: lies in the source, which is not to change: expected a folder beside it')


def _paths(options: dict[str, Any]) -> Iterator[tuple[str, Path]]:
    for name, value in options.items():
        for path in value if isinstance(value, (list, tuple)) else [value]:
            if isinstance(path, Path):
                yield name, path


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except OSError:
        return False
