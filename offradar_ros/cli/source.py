"""What a command is given: a data-set folder or a bag."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.bags.reader import is_bag
from offradar_ros.bags.sequence import BagSequence
from offradar_ros.config import RadarConfig
from offradar_ros.datasets.registry import open_sequence
from offradar_ros.datasets.sequence import RadarSequence
from offradar_ros.errors import DataError


def open_source(path: Path, layout: str, radar: RadarConfig) -> RadarSequence:
    """The scans at `path`; DataError if it is neither a bag nor a known data-set folder."""
    if not path.exists():
        raise DataError(f'{path}: no such folder')
    return BagSequence(path, radar) if is_bag(path) else open_sequence(path, layout, radar)
