"""RADIATE's lists of samples: lines ``Frame: 000001 Time: 1574859771.744660272``, in seconds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.folders import lines_of
from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns

_LINE = re.compile(r'Frame:\s*(\d+)\s+Time:\s*(\d+(?:\.\d*)?)\s*')


class Frame(NamedTuple):
    """One sample: the stem of its file and its stamp."""

    line: int
    name: str
    stamp_ns: int


def read_frames(path: Path) -> list[Frame]:
    """Every sample that a list names, in its order; DataError names the line that is not one."""
    frames = []
    for number, line in enumerate(lines_of(path), start=1):
        if not line.strip():
            continue
        found = _LINE.fullmatch(line.strip())
        try:
            if found is None:
                raise ValueError
            frames.append(Frame(number, found[1], parse_stamp_ns(found[2])))
        except ValueError:
            raise DataError(
                f'{path}, line {number}: expected "Frame: <number> Time: <seconds>", got {line[:60]!r}'
            ) from None
    if not frames:
        raise DataError(f'{path}: empty list: expected lines "Frame: <number> Time: <seconds>"')
    return frames
