"""Recorded drives, from bags or data-set folders."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.recordings.datasets.splits import Split
from offradar_ros.recordings.road import PositionedDrive, positioned, read_or_refuse
from offradar_ros.recordings.source import open_source
from offradar_ros.sequence import RadarSequence


@dataclasses.dataclass(frozen=True)
class RecordedDrive:
    """How to open a recording as a drive.

    Attributes:
        name: name of the drive.
        path: the bag or data-set folder.
        world: frame of its poses.
        origin: origin of that frame, latitude°, longitude°, altitude m; None for metric positions.
        spacing_m: distance for `subsample_by_distance`; 0 keeps all scans.
        split: a split whose test region is left out.
    """

    name: str
    path: str
    world: str
    origin: tuple[float, float, float] | None
    spacing_m: float
    split: Split | None = None

    def settings(self) -> dict[str, Any]:
        """All values; the recording itself is not read."""
        return dataclasses.asdict(self)

    def open(self) -> Drive:
        """The scans with a position on which training is allowed; DataError if there is none."""
        path = Path(self.path)
        frame = LocalFrame(GeoPoint(*self.origin)) if self.origin else None
        drive = positioned(open_source(path), path, frame, PositionConfig())
        if self.split:
            drive = part_of_split(drive, self.split, tested=False)
        if not len(drive):
            raise DataError(f'{path}: no scan has a position outside the test region: training needs them')
        return recorded_drive(drive.subsampled(self.spacing_m), self.world)


def part_of_split(drive: PositionedDrive, split: Split, *, tested: bool) -> PositionedDrive:
    """The scans in a split's test region, or those outside it and its buffer; DataError for metric positions."""
    if not split.region:
        return drive
    if drive.points_lla is None:
        raise DataError(
            f'{drive.path}: expected latitudes and longitudes, as split {split.name} has a test region, got metric '
            'positions'
        )
    return drive.only((split.tested if tested else split.trainable)(drive.points_lla))


def recorded_drive(drive: PositionedDrive, world: str) -> Drive:
    """A drive in the frame of a world."""
    opened = drive_of_scans(drive.sequence, drive.rows, drive.name, world)
    return dataclasses.replace(opened, poses=drive.poses, driven_m=drive.driven_m)


def drive_of_scans(sequence: RadarSequence, rows: NDArray[np.intp], name: str, world: str) -> Drive:
    """A drive of (N,) `rows` of a sequence, with unknown positions."""
    return Drive(
        name=name,
        world=world,
        key=f'{sequence.name}_{_digest(sequence, rows)}',
        stamps_ns=sequence.stamps_ns[rows],
        poses=np.full((len(rows), 3), np.nan),
        driven_m=np.zeros(len(rows)),
        kinds=np.full(len(rows), ''),
        severities=np.full(len(rows), np.nan),
        read_scan=lambda row: read_or_refuse(sequence, int(rows[row])),
        layout=sequence.layout,
    )


def _digest(sequence: RadarSequence, rows: NDArray[np.intp]) -> str:
    """Digest of the stamps and of the first readable scan, which depends on how the radar is read."""
    digest = hashlib.sha256(sequence.stamps_ns[rows].tobytes())
    for row in rows.tolist():
        try:
            scan = sequence.scan(row)
        except (DataError, RefusedInput):
            continue
        digest.update(scan.power.tobytes() + scan.azimuths_rad.tobytes() + repr(scan.range_resolution_m).encode())
        break
    return digest.hexdigest()[:16]
