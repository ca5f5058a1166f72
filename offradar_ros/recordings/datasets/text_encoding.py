"""Which encoding a text file is of: UTF-8, or UTF-16 as spreadsheets and Windows write it."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.bounded_input import read_bounded

_UTF_16 = (b'\xff\xfe', b'\xfe\xff')
_MOST_BYTES = 256 * 2**20


def encoding_of(start: bytes) -> str:
    """The encoding of a text that begins with these bytes; a mark of the order of bytes is no part of the text."""
    return 'utf-16' if start.startswith(_UTF_16) else 'utf-8-sig'


def encoding_of_file(path: Path) -> str:
    """The encoding of a regular file; OSError where it cannot be read."""
    with path.open('rb') as file:
        return encoding_of(file.read(2))


def read_lines(path: Path) -> list[str]:
    """Lines of a regular file; OSError where it cannot be read, ValueError where it is no text."""
    content = read_bounded(path, _MOST_BYTES)
    return content.decode(encoding_of(content)).splitlines()
