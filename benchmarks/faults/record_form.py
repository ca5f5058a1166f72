"""A form of record that is attacked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

Take = Callable[[bytes, Path], None]
"""Decodes a record and works on it; a file may be written at the path."""


@dataclasses.dataclass(frozen=True)
class Form:
    """A sound record of one form, what is done with it, the tries at full scale, and whether it is text."""

    name: str
    sound: bytes
    take: Take
    tries: int
    text: bool = False


class WrongValueTakenError(Exception):
    """A value that is not finite was taken."""
