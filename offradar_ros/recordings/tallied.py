"""A sequence that tells afterwards what was odd about its scans, and how the radar moved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.datasets.check.scan_faults import ScanFaults
from offradar_ros.recordings.datasets.check.stamps import check_stamps
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan


class TalliedSequence:
    """Another sequence, unchanged.

    Attributes:
        clock: the motion of the scans read so far.
    """

    def __init__(self, sequence: RadarSequence) -> None:
        self._sequence = sequence
        self.clock = ScanClock()
        self._faults = ScanFaults()

    def problems(self) -> tuple[str, ...]:
        """What `offradar check` would say of the stamps, and of the scans read so far, one line each."""
        found = (*self._faults.findings(), *check_stamps(self.stamps_ns))
        return tuple(finding.text for finding in found if finding.level == 'problem')

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
        self.clock.add(scan)
        self._faults.add(scan, f'at {scan.stamp_ns} ns')
        return scan
