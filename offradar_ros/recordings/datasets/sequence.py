"""A RadarSequence of one file a scan, as data sets have it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import Trajectory
from offradar_ros.positions.rules import require_stamp
from offradar_ros.recordings.datasets.coverage import fraction_covered, seconds_apart
from offradar_ros.recordings.datasets.position_file import PositionFile
from offradar_ros.types import PolarScan


@dataclasses.dataclass(frozen=True, eq=False)
class RecordedSequence:
    """A RadarSequence of one file a scan.

    Attributes:
        name: name of the data set's folder.
        layout: name in the registry.
        root: the folder that has this name.
        files: N files in the order of their stamps.
        stamps_ns: (N,) int64, never decreasing.
        read_scan: decodes a file, given its stamp.
        position_files: every known position file that is there, preferred first.
        warnings: what opening found wrong, one line each.
        remarks: what the layout does not contain, one line each.
    """

    name: str
    layout: str
    root: Path
    files: tuple[Path, ...]
    stamps_ns: NDArray[np.int64]
    read_scan: Callable[[Path, int], PolarScan]
    position_files: tuple[PositionFile, ...] = ()
    warnings: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.files)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, read and decoded at each call; RefusedInput('invalid_stamp') as `require_stamp`."""
        file, stamp_ns = self.files[index], int(self.stamps_ns[index])
        try:
            require_stamp(stamp_ns)
        except RefusedInput as refusal:
            raise RefusedInput(refusal.cause, f'{file}: {refusal}') from None
        return self.read_scan(file, stamp_ns)

    @property
    def trajectory(self) -> Trajectory | None:
        """Positions from the file that covers most scans, the preferred one among equals; None without any file.

        Read at first use. A damaged file is ignored; DataError if every one is damaged.
        """
        return None if self._chosen is None else self._chosen[1]

    @property
    def trajectory_path(self) -> Path | None:
        """The file that `trajectory` was read from."""
        return None if self._chosen is None else self._chosen[0].path

    @functools.cached_property
    def _chosen(self) -> tuple[PositionFile, Trajectory] | None:
        readable: list[tuple[PositionFile, Trajectory]] = []
        damage: list[DataError] = []
        for source in self.position_files:
            try:
                readable.append((source, source.read()))
            except DataError as error:
                damage.append(error)
        if damage and not readable:
            raise damage[0]
        return min(readable, key=lambda found: self._rank(found[1]), default=None)

    def _rank(self, trajectory: Trajectory) -> tuple[float, float]:
        """The least covers most scans; among those that cover none, it is the nearest in time."""
        return -fraction_covered(self.stamps_ns, trajectory), seconds_apart(self.stamps_ns, trajectory)


def in_stamp_order(files: Sequence[Path], stamps_ns: Sequence[int]) -> tuple[tuple[Path, ...], NDArray[np.int64]]:
    """Files and stamps sorted by stamp; those of equal stamps keep their order."""
    stamps = np.array(stamps_ns, np.int64)
    order = np.argsort(stamps, kind='stable')
    return tuple(files[i] for i in order), stamps[order]
