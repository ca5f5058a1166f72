"""Position files: what they hold, which rows are left out, and whether they cover the scans."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from offradar_ros.config import PositionConfig
from offradar_ros.errors import DataError
from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.datasets.check.coverage import coverage, duration
from offradar_ros.recordings.datasets.check.findings import Finding, counted, note, ok, problem
from offradar_ros.recordings.datasets.coverage import seconds_apart
from offradar_ros.recordings.datasets.position_file import PositionFile
from offradar_ros.recordings.datasets.sequence import RecordedSequence
from offradar_ros.recordings.left_out import left_out_text


def check_positions(sequence: RecordedSequence, position: PositionConfig, clock: ScanClock) -> Iterator[Finding]:
    """Findings about every position file, then about how the chosen one covers the scans and fits their motion."""
    if not sequence.position_files:
        yield note('no positions: scans can be encoded and queried, but not mapped or evaluated')
        return
    readable = 0
    for source in sequence.position_files:
        try:
            trajectory = source.read()
        except DataError as error:
            yield problem(str(error))
            continue
        readable += 1
        yield from _contents(source, trajectory, position.max_gap_s)
        apart_s = seconds_apart(sequence.stamps_ns, trajectory)
        if apart_s and source.path != sequence.trajectory_path:
            yield note(f'{source.path.name}: {duration(apart_s)} from the scans at the nearest: not of this drive')
    if readable and sequence.trajectory is not None and sequence.trajectory_path is not None:
        name, trajectory = sequence.trajectory_path.name, sequence.trajectory
        yield coverage(name, sequence.stamps_ns, trajectory, position)
        if not seconds_apart(sequence.stamps_ns, trajectory):
            yield from clock.findings(name, trajectory, position.max_gap_s)


def _contents(source: PositionFile, trajectory: Trajectory, max_gap_s: float) -> Iterator[Finding]:
    name = f'{source.title} ({source.path.name})'
    steps_s = np.diff(trajectory.stamps_ns) / 1e9
    rate = f', {1 / float(np.median(steps_s)):.1f} a second' if len(steps_s) else ''
    yield ok(f'{name}: {counted(len(trajectory), "position")}{rate}')
    for left_out in sorted(trajectory.left_out, key=lambda found: found.cause):
        text = left_out_text(name, left_out, 'row')
        yield note(text) if left_out.cause == 'repeated_position_stamp' else problem(text)
    gaps = steps_s[steps_s > max_gap_s]
    if len(gaps):
        yield note(f'{name}: {counted(len(gaps), "gap")} over {max_gap_s:g} s, the longest {gaps.max():.1f} s')
