"""Sizes of scans: one is expected, any other is a problem."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from offradar_ros.recordings.datasets.check.findings import Finding, counted, ok, problem
from offradar_ros.types import PolarScan


class Sizes:
    """Counts scans by azimuths, range bins and size of a bin."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[int, int, float]] = Counter()
        self._first: dict[tuple[int, int, float], str] = {}

    def add(self, scan: PolarScan, name: str) -> None:
        """Count a scan, which is reported by `name`."""
        size = (int(scan.power.shape[0]), int(scan.power.shape[1]), scan.range_resolution_m)
        self._counts[size] += 1
        self._first.setdefault(size, name)

    def findings(self) -> Iterator[Finding]:
        """The usual size, then odd ones."""
        for number, (size, count) in enumerate(self._counts.most_common()):
            azimuths, bins, resolution_m = size
            text = f'{counted(count, "scan")} of {azimuths} azimuths × {bins} range bins of {resolution_m:g} m'
            yield ok(text) if number == 0 else problem(f'odd size: {text}, first {self._first[size]}')
