"""All checks of a data-set folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.datasets.check.findings import Finding, Findings, counted, note, ok, problem
from offradar_ros.recordings.datasets.check.positions import check_positions
from offradar_ros.recordings.datasets.check.scans import check_scans
from offradar_ros.recordings.datasets.check.stamps import check_stamps
from offradar_ros.recordings.datasets.registry import open_sequence
from offradar_ros.recordings.datasets.sequence import RecordedSequence


def check_folder(
    path: str | Path,
    layout: str = 'auto',
    *,
    radar: RadarConfig | None = None,
    position: PositionConfig | None = None,
    sample: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Findings:
    """Open a folder, decode every scan (or `sample` of them, evenly spread) and read every position file.

    `progress` is called before each scan with its number, from 1, and how many there are.

    DataError where the folder holds no recognised scans; every other problem is a finding.
    """
    sequence = open_sequence(path, layout, radar)
    found = tuple(_findings(sequence, position or PositionConfig(), sample, progress))
    return Findings(Path(path), sequence.layout, found)


def _findings(
    sequence: RecordedSequence,
    position: PositionConfig,
    sample: int,
    progress: Callable[[int, int], None] | None,
) -> Iterator[Finding]:
    yield ok(
        f'{sequence.layout} sequence {sequence.name}: {counted(len(sequence), "scan")} in {sequence.files[0].parent}'
    )
    for warning in sequence.warnings:
        yield problem(warning)
    for remark in sequence.remarks:
        yield note(remark)
    clock = ScanClock()
    yield from check_stamps(sequence.stamps_ns, [file.name for file in sequence.files])
    yield from check_scans(sequence, sample, progress, clock.add)
    yield from check_positions(sequence, position, clock)
