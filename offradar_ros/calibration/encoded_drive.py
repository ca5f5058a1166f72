"""Validation drives, encoded, and the maps that are made of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.encode import encode_all
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import DataError
from offradar_ros.processes import Progress
from offradar_ros.recordings.road import PositionedDrive
from offradar_ros.recordings.spacing import subsample_by_distance
from offradar_ros.types import PlaceTable


@dataclasses.dataclass(frozen=True, eq=False)
class EncodedDrive:
    """One validation drive of N scans, encoded.

    Attributes:
        name: what people call the drive.
        stamps_ns: (N,) int64 scan stamps.
        poses: (N, 3) float64, x and y in metres and heading in radians, in one frame for all drives.
        driven_m: (N,) float64, metres driven up to each scan.
        means: (N, d) float32 descriptors, NaN where the encoder refused the scan.
        uncertainties: (N,) float64, infinite where the encoder refused the scan.
    """

    name: str
    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    driven_m: NDArray[np.float64]
    means: NDArray[np.float32]
    uncertainties: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.uncertainties)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(N,) whether a scan has a descriptor."""
        return np.isfinite(self.uncertainties)

    def map_rows(self, spacing_m: float) -> NDArray[np.intp]:
        """(P,) the scans that a map with a place every `spacing_m` holds; refused ones are left out."""
        usable = np.flatnonzero(self.usable)
        return usable[subsample_by_distance(self.driven_m[usable], spacing_m)]

    def places(self, rows: NDArray[np.intp]) -> PlaceTable:
        """The map that is made of these scans, with ids 0, 1, …"""
        count = len(rows)
        return PlaceTable(
            np.arange(count, dtype=np.int64),
            np.ones(count, np.int32),
            self.stamps_ns[rows],
            np.column_stack([self.poses[rows, :2], np.zeros(count)]),
            self.poses[rows, 2],
            np.full(count, np.nan, np.float32),
            self.uncertainties[rows].astype(np.float32),
            self.means[rows],
        )


def encoded_drives(
    drives: Sequence[PositionedDrive], encoder: Encoder, progress: Progress | None = None
) -> list[EncodedDrive]:
    """The drives, encoded; `progress` gets (done, scans) over the scans of all of them.

    DataError for a drive without a usable scan.
    """
    total, done, encoded = sum(len(drive) for drive in drives), 0, []
    for drive in drives:

        def advance(done_of_drive: int, _: int, before: int = done) -> None:
            if progress is not None:
                progress(before + done_of_drive, total)

        means, variances = encode_all(encoder, drive, advance)
        uncertainties = variances.mean(axis=1, dtype=np.float64)
        uncertainties[~(np.isfinite(means).all(axis=1) & np.isfinite(uncertainties))] = np.inf
        made = EncodedDrive(drive.name, drive.stamps_ns, drive.poses, drive.driven_m, means, uncertainties)
        if not made.usable.any():
            raise DataError(f'{drive.name}: none of its {len(drive)} scans can be encoded')
        encoded.append(made)
        done += len(drive)
    return encoded
