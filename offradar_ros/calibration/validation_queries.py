"""Drives of one road searched in each other's maps: which answers are wrong, and the U of each scan."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.recordings.spacing import subsample_by_distance
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import PlaceTable

SQUARE_M = 100.0
"""Side of a square of ground. Errors of answers within one square are correlated."""


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


@dataclasses.dataclass(frozen=True, eq=False)
class ValidationQueries:
    """One row for each of Q scans, of all drives.

    Attributes:
        drives: number of drives.
        uncertainties: (Q,) float64, infinite where the encoder refused the scan.
        wrong: (Q,) bool, whether the nearest place in embedding space is further away than the tolerance.
        positive: (Q,) bool, whether the map holds a place within the tolerance.
        squares: (Q,) int64, index of the square of `SQUARE_M` in which the scan was taken; drives share the squares.
    """

    drives: int
    uncertainties: NDArray[np.float64]
    wrong: NDArray[np.bool_]
    positive: NDArray[np.bool_]
    squares: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.uncertainties)

    @property
    def refused(self) -> int:
        """Number of scans that the encoder refused."""
        return int(np.sum(~np.isfinite(self.uncertainties)))


def validation_queries(drives: Sequence[EncodedDrive], spacing_m: float, tolerance_m: float) -> ValidationQueries:
    """Search every drive's map, a place every `spacing_m`, for scans of every other drive.

    Each scan counts once. Searched in several maps, it would mostly be right in all or wrong in all, and the bounds
    would take these answers for independent ones. Scan i is searched in the map of other drive i, modulo their number.
    DataError for a drive without a usable scan, and where no scan has a right place in any map.
    """
    for drive in drives:
        if not drive.usable.any():
            raise DataError(f'{drive.name}: none of its {len(drive)} scans can be encoded')
    maps = [_Map(drive, spacing_m) for drive in drives]
    wrong, positive = [], []
    for number, query in enumerate(drives):
        others = maps[:number] + maps[number + 1 :]
        found = [others[scan % len(others)].search(query, scan, tolerance_m) for scan in range(len(query))]
        wrong += [is_wrong for is_wrong, _ in found]
        positive += [is_positive for _, is_positive in found]
    if not any(positive):
        raise DataError(
            f'{", ".join(drive.name for drive in drives)}: no scan is within {tolerance_m:g} m of another drive: '
            'expected drives of one road'
        )
    corners = np.floor(np.concatenate([query.poses[:, :2] for query in drives]) / SQUARE_M)
    return ValidationQueries(
        len(drives),
        np.concatenate([query.uncertainties for query in drives]),
        np.array(wrong, np.bool_),
        np.array(positive, np.bool_),
        np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64),
    )


class _Map:
    """One drive as a map, a place every `spacing_m`; refused scans are left out."""

    def __init__(self, drive: EncodedDrive, spacing_m: float) -> None:
        usable = np.flatnonzero(drive.usable)
        rows = usable[subsample_by_distance(drive.driven_m[usable], spacing_m)]
        count = len(rows)
        self._positions_m = drive.poses[rows, :2]
        self._index = PlaceIndex(drive.means.shape[1], count)
        self._index.upsert(
            PlaceTable(
                np.arange(count, dtype=np.int64),
                np.ones(count, np.int32),
                drive.stamps_ns[rows],
                np.column_stack([self._positions_m, np.zeros(count)]),
                drive.poses[rows, 2],
                drive.uncertainties[rows].astype(np.float32),
                drive.means[rows],
            )
        )

    def search(self, query: EncodedDrive, scan: int, tolerance_m: float) -> tuple[bool, bool]:
        """Whether the answer to a scan is wrong, and whether there is a right one."""
        away_m = np.hypot(*(self._positions_m - query.poses[scan, :2]).T)
        wrong = True
        if query.usable[scan]:
            nearest = self._index.search(query.means[scan], 1)[0]
            wrong = bool(away_m[nearest.place_id] > tolerance_m)
        return wrong, bool(away_m.min() <= tolerance_m)
