"""Recorded drives as training data."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.lab.training.drive import OpenDrive
from offradar_ros.recordings.datasets.registry import open_sequence
from offradar_ros.recordings.datasets.scan_positions import scan_positions
from offradar_ros.recordings.datasets.splits import Split

_ONE_REGION_M = 50_000.0
_MAX_GAP_NS = 1_500_000_000


@dataclasses.dataclass(frozen=True)
class RecordedDrive:
    """A data-set folder; `origin` of the world's frame in degrees and metres, None where positions are metric.

    Scans that `split` keeps from training are left out.
    """

    path: str
    spacing_m: float
    world: str
    origin: tuple[float, float, float] | None
    split: Split | None = None

    @property
    def name(self) -> str:
        """The folder's name."""
        return open_sequence(self.path).name

    def open(self) -> OpenDrive:
        """Every scan with a position that is `spacing_m` or more from the last one taken."""
        sequence = open_sequence(self.path)
        trajectory = sequence.trajectory
        if trajectory is None:
            raise DataError(f'{self.path}: training needs positions, and there are none')
        allowed = self._allowed(sequence.stamps_ns, trajectory)
        trajectory = trajectory.in_frame(LocalFrame(GeoPoint(*self.origin)) if self.origin else None)
        indices: list[int] = []
        poses: list[NDArray[np.float64]] = []
        for index in np.flatnonzero(allowed).tolist():
            pose = trajectory.at(int(sequence.stamps_ns[index]), _MAX_GAP_NS)
            if pose is None:
                continue
            here = np.array([pose.x_m, pose.y_m, pose.yaw_rad])
            if not poses or np.hypot(*(here - poses[-1])[:2]) >= self.spacing_m:
                indices.append(index)
                poses.append(here)
        if not indices:
            where = ' outside the test region' if self.split and self.split.region else ''
            raise DataError(f'{self.path}: no scan has a position{where}: training needs them')
        count = len(indices)
        return OpenDrive(
            sequence, np.array(indices), np.array(poses), ('',) * count, np.full(count, np.nan, np.float32)
        )

    def _allowed(self, stamps_ns: NDArray[np.int64], trajectory: Trajectory) -> NDArray[np.bool_]:
        """(N,) bool: which scans may be trained on."""
        if self.split is None or not self.split.region:
            return np.ones(len(stamps_ns), np.bool_)
        if not trajectory.geodetic:
            raise DataError(
                f'{self.path}: expected latitudes and longitudes, as split {self.split.name} has a test region'
            )
        return self.split.trainable(scan_positions(stamps_ns, trajectory, _MAX_GAP_NS))


def recorded_drives(paths: Sequence[str], spacing_m: float, split: Split | None = None) -> list[RecordedDrive]:
    """A drive for each folder, without the scans that `split` keeps from training.

    Drives whose positions are geodetic share a world with those that start within 50 km.

    One with positions in a frame of its own is a world by itself: nobody says where its frame is.
    """
    regions: list[tuple[str, LocalFrame]] = []
    drives = []
    for path in paths:
        trajectory = open_sequence(path).trajectory
        if trajectory is None:
            raise DataError(f'{path}: training needs positions, and there are none')
        origin = trajectory.origin()
        if origin is None:
            drives.append(RecordedDrive(path, spacing_m, path, None, split))
            continue
        found = next((region for region in regions if _away_m(region[1], origin) < _ONE_REGION_M), None)
        if found is None:
            found = (path, LocalFrame(origin))
            regions.append(found)
        start = found[1].origin
        drives.append(
            RecordedDrive(path, spacing_m, found[0], (start.latitude_deg, start.longitude_deg, start.altitude_m), split)
        )
    return drives


def _away_m(frame: LocalFrame, point: GeoPoint) -> float:
    enu: NDArray[np.float64] = frame.to_enu(np.array([dataclasses.astuple(point)]))
    return float(np.linalg.norm(enu))
