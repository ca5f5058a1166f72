"""One recording to a rosbag2 folder, and what there is to tell about it."""

import dataclasses
from pathlib import Path
from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig
from offradar_ros.errors import DataError, OffradarError
from offradar_ros.processes import Progress
from offradar_ros.recordings.bags.writer import BagOptions, write_bag
from offradar_ros.recordings.datasets.check.coverage import coverage
from offradar_ros.sequence import RadarSequence


class Conversion(NamedTuple):
    """Attributes: what was written of a sequence.

    scans: how many the sequence has.
    skipped: why each scan that cannot be read was left out.
    lack: which scans have no position and why; empty where none lacks one.
    """

    scans: int
    skipped: list[str]
    lack: str


def convert_sequence(
    sequence: RadarSequence, out: Path, options: BagOptions, skip_unreadable: bool, progress: Optional[Progress] = None
) -> Conversion:
    """Write the bag `out`; DataError where that cannot be done, or a scan cannot be read and those are not skipped."""
    skipped: dict[int, OffradarError] = {}

    def skip(index: int, error: OffradarError) -> None:
        if not skip_unreadable:
            raise DataError(f'{error} (--skip-unreadable leaves such scans out)') from error
        skipped[index] = error

    write_bag(sequence, out, options, progress, skip)
    written_ns = np.delete(sequence.stamps_ns, list(skipped))
    lack = _lack_of_positions(sequence, written_ns, options.position_offset_ns)
    return Conversion(len(sequence), list(map(str, skipped.values())), lack)


def _lack_of_positions(sequence: RadarSequence, scans_ns: NDArray[np.int64], offset_ns: int) -> str:
    """In the words of `offradar check`."""
    trajectory = sequence.trajectory
    if trajectory is None:
        return 'no positions: the source has none; this bag can be queried with, not mapped'
    moved = dataclasses.replace(trajectory, stamps_ns=trajectory.stamps_ns + offset_ns)
    found = coverage('positions', scans_ns, moved, PositionConfig().max_gap_s, offset_ns / 1e9)
    return found.text if found.level == 'problem' else ''
