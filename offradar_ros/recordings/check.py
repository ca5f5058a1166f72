"""Check of a bag or a data-set folder: what it holds, and every problem that is found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.recordings.bags.check import check_bag
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.datasets.check.findings import Findings
from offradar_ros.recordings.datasets.check.folder import check_folder
from offradar_ros.recordings.source import is_bag, require_bag


def check_recording(
    path: Path,
    layout: str = 'auto',
    *,
    radar: RadarConfig | None = None,
    position: PositionConfig | None = None,
    topics: ChosenTopics | None = None,
    sample: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Findings:
    """Check every message of a bag, or every scan of a folder (or `sample` of them) and every position file.

    `topics` chooses among those of a bag.

    `progress` gets (scan, scans) before each scan of a folder, from 1; for a bag (1, 1) at the end. DataError where
    `path` cannot be opened; every other problem is a finding.
    """
    require_bag(path, topics)
    if is_bag(path):
        found = check_bag(path, radar, position, topics)
        if progress is not None:
            progress(1, 1)
        return found
    return check_folder(path, layout, radar=radar, position=position, sample=sample, progress=progress)
