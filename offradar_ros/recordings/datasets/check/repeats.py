"""Scans that are there again under another stamp."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.radar.repeated_power import RepeatedPower
from offradar_ros.recordings.datasets.check.findings import Finding, counted, first_few, problem
from offradar_ros.types import PolarScan


class Repeats:
    """Collects the scans that repeat the one before."""

    def __init__(self) -> None:
        self._power = RepeatedPower()
        self._names: list[str] = []

    def add(self, scan: PolarScan, name: str) -> None:
        """Add the next scan, which is reported by `name`."""
        if self._power.is_repeated(scan):
            self._names.append(name)

    def findings(self) -> Iterator[Finding]:
        """A problem, if any scan does."""
        if self._names:
            yield problem(
                f'{counted(len(self._names), "scan")} with the very power of the one before, which no radar measures: '
                f'the driver or the recording repeats it ({first_few(self._names)})'
            )
