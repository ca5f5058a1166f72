"""Model files on disk: found or reported, written whole or not at all."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from offradar_ros.errors import ModelError
from offradar_ros.records import write_whole_file


def require_file(path: str | Path) -> str:
    """The path, if a file is there; ModelError otherwise."""
    if not Path(path).is_file():
        raise ModelError(f'{path}: no such weights file')
    return str(path)


def require_package(package: str, path: str | Path) -> None:
    """ModelError where a package that the weights at `path` need is not installed."""
    if importlib.util.find_spec(package) is None:
        raise ModelError(f'{path}: needs the Python package {package}, which is not installed')


def first_line(error: BaseException) -> str:
    """One line of another library's error."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:300]


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write a file that either is complete or is not there; ModelError where it cannot be written."""
    target = Path(path)
    if target.is_dir():
        raise ModelError(f'{path}: cannot be written (a folder is there)')
    try:
        write_whole_file(target, content)
    except OSError as error:
        raise ModelError(f'{path}: cannot be written ({error.strerror})') from error
