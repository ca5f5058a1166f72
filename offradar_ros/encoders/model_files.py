"""Model files on disk: checks with clear errors, bounded reads and whole writes."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from offradar_ros.bounded_input import read_bounded
from offradar_ros.errors import ModelError
from offradar_ros.whole_file import write_whole_file

MAX_MODEL_BYTES = 2**31
"""Largest weights file; a protocol buffer, such as ONNX, cannot be larger."""


def require_file(path: str | Path) -> str:
    """`path` as text if the file exists; ModelError otherwise."""
    try:
        found = Path(path).is_file()
    except OSError as error:
        raise ModelError(f'{path}: cannot be read ({error.strerror})') from error
    if not found:
        raise ModelError(f'{path}: no such weights file')
    return str(path)


def read_model_file(path: str | Path) -> bytes:
    """Content of a weights file; ModelError if it is missing, no regular file, unreadable or too large."""
    try:
        return read_bounded(require_file(path), MAX_MODEL_BYTES)
    except OSError as error:
        raise ModelError(f'{path}: cannot be read ({error.strerror or error})') from error


def require_package(package: str, path: str | Path) -> None:
    """ModelError if a package that the weights at `path` need is not installed."""
    if importlib.util.find_spec(package) is None:
        raise ModelError(f'{path}: needs the Python package {package}, which is not installed')


def first_line(error: BaseException) -> str:
    """The first line of another library's error, at most 300 characters."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:300]


def write_atomically(path: str | Path, content: bytes) -> None:
    """Write a file atomically: it is complete or does not exist. ModelError if it cannot be written."""
    target = Path(path)
    if target.is_dir():
        raise ModelError(f'{path}: cannot be written (a folder is there)')
    try:
        write_whole_file(target, content)
    except OSError as error:
        raise ModelError(f'{path}: cannot be written ({error.strerror})') from error
