"""What is odd about scans that can be read: the same rules for folders, for bags, and for what is converted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from offradar_ros.recordings.datasets.check.findings import Finding, counted, first_few, note, problem
from offradar_ros.recordings.datasets.check.repeats import Repeats
from offradar_ros.recordings.datasets.check.sizes import Sizes
from offradar_ros.types import PolarScan

# A file's stamp may be that of any row, and a driver may stamp the end of a rotation as it writes the file.
_ROW_STAMP_SLACK_NS = 50_000_000
# Neighbouring rows further apart than this many typical steps have lost a row between them.
_LOST_ROW_STEPS = 1.5
_ROW_FAULTS = {
    'angle_interpolated': 'encoder counts that contradict the others, their azimuths are interpolated',
    'stamp_interpolated': 'row stamps that contradict the others, interpolated',
    'stamp_unusable': "row stamps of a clock that was never set, or in no order: the scan's stamp is taken instead",
    'damaged': 'damaged lines, rows without power',
    'no_power': 'azimuths without any power (partial rotation)',
    'saturated': 'azimuths whose every power value is 255',
    'missing': 'fewer rows than radar.azimuth_samples, they are placed in the first part of a turn',
}
"""What `PolarScan.row_faults` counts, in words."""


class ScanFaults:
    """Collects scans, in their order."""

    def __init__(self) -> None:
        self._sizes, self._repeats = Sizes(), Repeats()
        self._faults: dict[str, list[str]] = {}

    def add(self, scan: PolarScan, name: str) -> None:
        """Add the next scan, which is reported by `name`."""
        self._sizes.add(scan, name)
        self._repeats.add(scan, name)
        for fault in (*(_ROW_FAULTS[fault] for fault in scan.row_faults), *_faults_of_turn(scan)):
            self.add_fault(fault, name)

    def add_fault(self, fault: str, name: str) -> None:
        """Add a fault of a scan, in words."""
        self._faults.setdefault(fault, []).append(name)

    def findings(self) -> Iterator[Finding]:
        """The usual size, odd ones, repeated scans, then one line for each fault."""
        yield from self._sizes.findings()
        yield from self._repeats.findings()
        for fault, names in self._faults.items():
            found = note if fault == _ROW_FAULTS['saturated'] else problem
            yield found(f'{fault}: {counted(len(names), "scan")} ({first_few(names)})')


def _faults_of_turn(scan: PolarScan) -> Iterator[str]:
    """What is odd about a scan's azimuths and stamp, in words."""
    steps = np.diff(np.sort(scan.azimuths_rad))
    if len(steps) == 0:
        yield 'a single azimuth'
        return
    typical = float(np.median(steps))
    wrap = 2 * np.pi - float(np.ptp(scan.azimuths_rad))
    if np.count_nonzero(np.append(steps, wrap) > _LOST_ROW_STEPS * typical):
        yield 'azimuths missing from the rotation'
    if np.count_nonzero(steps < 0.5 * typical):
        yield 'azimuths measured twice (encoder steps of less than half the usual)'
    stamps = scan.azimuth_stamps_ns
    if stamps is None or 'stamp_unusable' in scan.row_faults:
        return
    early, late = int(stamps.min()) - _ROW_STAMP_SLACK_NS, int(stamps.max()) + _ROW_STAMP_SLACK_NS
    if not early <= scan.stamp_ns <= late:
        yield 'stamp of the scan is not within the stamps of its rows'
