"""Conversion of one recording to a rosbag2 folder, and its report."""

import dataclasses
from pathlib import Path
from typing import NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import DataError, OffradarError
from offradar_ros.positions.clocks import clock_problem
from offradar_ros.processes import Progress
from offradar_ros.recordings.bags.writer import BagOptions, write_bag
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.datasets.check.coverage import coverage
from offradar_ros.recordings.left_out import left_out_text
from offradar_ros.recordings.tallied import TalliedSequence
from offradar_ros.sequence import RadarSequence


class Conversion(NamedTuple):
    """Report of a conversion.

    Attributes:
        scans: number of scans of the sequence.
        skipped: for each scan that was left out, why it cannot be read.
        position_problem: how many scans have no position, and why; empty if every scan has one.
        warnings: scans and stamps that are odd, positions that were left out, clocks that disagree, one line each.
    """

    scans: int
    skipped: list[str]
    position_problem: str
    warnings: tuple[str, ...] = ()


def as_recorded(radar: RadarConfig) -> RadarConfig:
    """How a source is read that is written again: angles from the sensor's own zero, in its own sense.

    Both belong to the mounting, and are applied when the bag is read.
    """
    return dataclasses.replace(radar, azimuth_offset_rad=0.0, azimuth_direction='clockwise')


def convert_sequence(
    sequence: RadarSequence, out: Path, options: BagOptions, skip_unreadable: bool, progress: Optional[Progress] = None
) -> Conversion:
    """Write the bag `out`; DataError where it cannot be written, or a scan cannot be read and is not to be skipped."""
    skipped: dict[int, OffradarError] = {}

    def skip(index: int, error: OffradarError) -> None:
        if not skip_unreadable:
            where = '' if str(sequence.name) in str(error) else f'{sequence.name}, scan {index}: '
            raise DataError(f'{where}{error} (--skip-unreadable leaves such scans out)') from error
        skipped[index] = error

    tallied = TalliedSequence(sequence)
    write_bag(tallied, out, options, progress, skip)
    written_ns = np.delete(sequence.stamps_ns, list(skipped))
    position_problem = _position_problem(sequence, written_ns, options.position_offset_ns)
    warnings = _position_warnings(sequence, tallied.clock, options.position_offset_ns)
    warnings = (*tallied.problems(), *warnings)
    return Conversion(len(sequence), list(map(str, skipped.values())), position_problem, warnings)


def _position_warnings(sequence: RadarSequence, clock: ScanClock, offset_ns: int) -> tuple[str, ...]:
    trajectory = sequence.trajectory
    if trajectory is None:
        return ()
    moved = dataclasses.replace(trajectory, stamps_ns=trajectory.stamps_ns + offset_ns)
    given_s = offset_ns / 1e9
    by_arrival = None if trajectory.clock_offset_s is None else trajectory.clock_offset_s - given_s
    clocks = clock_problem(by_arrival, given_s=given_s) or clock.problem(moved, PositionConfig().max_gap_s, given_s)
    left_out = tuple(
        left_out_text('positions', found) for found in trajectory.left_out if found.cause != 'repeated_position_stamp'
    )
    return (*left_out, clocks) if clocks else left_out


def _position_problem(sequence: RadarSequence, scans_ns: NDArray[np.int64], offset_ns: int) -> str:
    """The problem that `offradar check` would report; empty if there is none."""
    trajectory = sequence.trajectory
    if trajectory is None:
        return 'no positions: the source has none; this bag can be queried with, not mapped'
    moved = dataclasses.replace(trajectory, stamps_ns=trajectory.stamps_ns + offset_ns)
    found = coverage('positions', scans_ns, moved, PositionConfig(), offset_ns / 1e9)
    return found.text if found.level == 'problem' else ''
