"""Recorded drives as training data."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from offradar_ros.config import PositionConfig
from offradar_ros.errors import DataError
from offradar_ros.geometry import GeoPoint, LocalFrame
from offradar_ros.lab.training.drive import OpenDrive
from offradar_ros.recordings.datasets.splits import Split
from offradar_ros.recordings.road import PositionedDrive, positioned, shared_frames, start_of
from offradar_ros.recordings.source import open_source


@dataclasses.dataclass(frozen=True)
class RecordedDrive:
    """A bag or data-set folder; `origin` of the world's frame in degrees and metres, None where positions are metric.

    Scans that `split` keeps from training are left out.
    """

    name: str
    path: str
    spacing_m: float
    world: str
    origin: tuple[float, float, float] | None
    split: Split | None = None

    def open(self) -> OpenDrive:
        """The first scan with a position in each stretch of `spacing_m` metres driven."""
        path = Path(self.path)
        frame = LocalFrame(GeoPoint(*self.origin)) if self.origin else None
        drive = positioned(open_source(path), path, frame, PositionConfig().max_gap_s)
        drive = self._trainable(drive).subsampled(self.spacing_m)
        count = len(drive)
        if not count:
            raise DataError(f'{path}: no scan has a position outside the test region: training needs them')
        return OpenDrive(drive.sequence, drive.rows, drive.poses, ('',) * count, np.full(count, np.nan, np.float32))

    def _trainable(self, drive: PositionedDrive) -> PositionedDrive:
        if self.split is None or not self.split.region:
            return drive
        if drive.points_lla is None:
            raise DataError(
                f'{self.path}: expected latitudes and longitudes, as split {self.split.name} has a test region'
            )
        return drive.only(self.split.trainable(drive.points_lla))


def recorded_drives(paths: Sequence[str], spacing_m: float, split: Split | None = None) -> list[RecordedDrive]:
    """A drive for each bag or folder, without the scans that `split` keeps from training.

    Drives whose positions are geodetic share a world with those that start within 50 km; one with positions in a frame
    of its own is a world by itself. DataError for one without positions.
    """
    starts = [start_of(Path(path)) for path in paths]
    return [
        RecordedDrive(
            start.name,
            str(start.path),
            spacing_m,
            str(first.path),
            dataclasses.astuple(first.origin) if first.origin else None,
            split,
        )
        for start, first in zip(starts, shared_frames(starts), strict=True)
    ]
