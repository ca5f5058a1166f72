"""A file of positions beside the scans, and how to read it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import NamedTuple, Protocol

from offradar_ros.geometry import Trajectory


class Reader(Protocol):
    """Reads a trajectory; counts in `tally` the rows that it leaves out, by reason."""

    def __call__(self, path: Path, tally: Counter[str] | None = None) -> Trajectory:
        """The file's trajectory; DataError names the file, line and what was expected."""


class PositionFile(NamedTuple):
    """A file of positions, the title under which it is reported, and the function that reads it."""

    title: str
    path: Path
    reader: Reader

    def read(self, tally: Counter[str] | None = None) -> Trajectory:
        """The trajectory, read at each call."""
        return self.reader(self.path, tally)


def present(*sources: PositionFile) -> tuple[PositionFile, ...]:
    """Those whose file exists, in order."""
    return tuple(source for source in sources if source.path.is_file())
