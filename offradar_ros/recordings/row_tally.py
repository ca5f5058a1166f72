"""A sequence that tells afterwards what was odd about its scans, which rows were mended, and how the radar moved."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.datasets.check.findings import counted
from offradar_ros.recordings.datasets.check.repeats import Repeats
from offradar_ros.recordings.datasets.check.scans import scan_faults
from offradar_ros.recordings.datasets.check.sizes import Sizes
from offradar_ros.recordings.datasets.check.stamps import check_stamps
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

MENDED = ('angle_interpolated', 'stamp_interpolated', 'stamp_unusable', 'damaged')
"""The row faults (`PolarScan.row_faults`) of which nothing is left in a scan that is written again."""


class TalliedSequence:
    """Another sequence, unchanged.

    Attributes:
        faults: number of the scans read so far by what was wrong with some of their rows and has been mended.
        clock: the motion of the scans read so far.
    """

    def __init__(self, sequence: RadarSequence) -> None:
        self._sequence = sequence
        self.faults: Counter[str] = Counter()
        self.clock = ScanClock()
        self._sizes, self._repeats = Sizes(), Repeats()
        self._odd: Counter[str] = Counter()

    def problems(self) -> tuple[str, ...]:
        """What `offradar check` would say of the stamps, and of the scans read so far, one line each."""
        found = (*self._sizes.findings(), *self._repeats.findings(), *check_stamps(self.stamps_ns))
        odd = (f'{fault}: {counted(count, "scan")}' for fault, count in self._odd.items())
        return (*(finding.text for finding in found if finding.level == 'problem'), *odd)

    @property
    def name(self) -> str:
        """Name of the recording, for people."""
        return self._sequence.name

    @property
    def layout(self) -> str:
        """Layout of the recording."""
        return self._sequence.layout

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64 scan stamps in nanoseconds, never decreasing."""
        return self._sequence.stamps_ns

    @property
    def trajectory(self) -> Trajectory | None:
        """The most accurate positions of the recording, or None."""
        return self._sequence.trajectory

    def __len__(self) -> int:
        return len(self._sequence)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`; raises as the sequence does."""
        scan = self._sequence.scan(index)
        self.faults.update(fault for fault in scan.row_faults if fault in MENDED)
        self.clock.add(scan)
        self._sizes.add(scan, f'at {scan.stamp_ns} ns')
        self._repeats.add(scan, f'at {scan.stamp_ns} ns')
        self._odd.update(scan_faults(scan))
        return scan
