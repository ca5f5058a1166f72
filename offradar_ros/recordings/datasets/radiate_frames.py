"""RADIATE's lists of samples: lines ``Frame: 000001 Time: 1574859771.744660272``, in seconds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from offradar_ros.errors import DataError
from offradar_ros.recordings.datasets.folders import lines_of
from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns

MOST_DAMAGED = 0.25
_LINE = re.compile(r'Frame:\s*(\d+)\s+Time:\s*(\d+(?:\.\d*)?)\s*')


class Frame(NamedTuple):
    """One sample: the stem of its file and its stamp."""

    line: int
    name: str
    stamp_ns: int


def read_frames(path: Path) -> tuple[list[Frame], list[DataError]]:
    """Every sample that a list names, in its order, and an error for each line that is damaged.

    DataError names the first of these where they are more than a quarter of all lines, or where there is no line.
    """
    frames: list[Frame] = []
    damage: list[DataError] = []
    for number, line in enumerate(lines_of(path), start=1):
        if not line.strip():
            continue
        found = _LINE.fullmatch(line.strip())
        try:
            if found is None:
                raise ValueError
            frames.append(Frame(number, found[1], parse_stamp_ns(found[2])))
        except ValueError:
            damage.append(
                DataError(f'{path}, line {number}: expected "Frame: <number> Time: <seconds>", got {line[:60]!r}')
            )
    if len(damage) > MOST_DAMAGED * (len(frames) + len(damage)):
        raise damage[0]
    if not frames:
        raise DataError(f'{path}: empty list: expected lines "Frame: <number> Time: <seconds>"')
    return frames, damage
