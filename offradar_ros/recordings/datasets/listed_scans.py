"""Differences between a data set's list of scans and its files."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

from offradar_ros.recordings.datasets.stamp_names import stamp_of_name


def listing_differences(listing: Path, listed: Sequence[int], files: Sequence[Path], unit_ns: int) -> list[str]:
    """A line for each kind of difference between the stamps in a list, in ns, and the files that are named by stamp.

    `unit_ns` is the unit of the names: 1000 where files are named in microseconds.
    """
    differences = []
    backwards = sum(later < earlier for earlier, later in itertools.pairwise(listed))
    if backwards:
        differences.append(f'{listing}: stamps that go backwards: {backwards}')
    distinct = set(listed)
    if len(distinct) < len(listed):
        differences.append(f'{listing}: stamps listed more than once: {len(listed) - len(distinct)}')
    missing = sorted(distinct - {stamp_of_name(file) for file in files})
    extra = sorted(file.name for file in files if stamp_of_name(file) not in distinct)
    if missing:
        first = f'{missing[0] // unit_ns}{files[0].suffix}'
        differences.append(f'{listing}: {len(missing)} of {len(listed)} listed scans have no file, first {first}')
    if extra:
        differences.append(f'{listing}: {len(extra)} of {len(files)} files are not listed, first {extra[0]}')
    return differences
