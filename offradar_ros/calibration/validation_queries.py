"""Drives of one road searched in each other's maps: which answers are wrong, and the U of each scan."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.encoded_drive import EncodedDrive
from offradar_ros.calibration.stretches import squares
from offradar_ros.errors import DataError
from offradar_ros.retrieval.place_index import PlaceIndex


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
    DataError where no scan has a right place in any map.
    """
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
    return ValidationQueries(
        len(drives),
        np.concatenate([query.uncertainties for query in drives]),
        np.array(wrong, np.bool_),
        np.array(positive, np.bool_),
        squares(np.concatenate([query.poses[:, :2] for query in drives])),
    )


class _Map:
    """One drive as a map, a place every `spacing_m`; refused scans are left out."""

    def __init__(self, drive: EncodedDrive, spacing_m: float) -> None:
        places = drive.places(drive.map_rows(spacing_m))
        self._positions_m = places.positions_m[:, :2]
        self._index = PlaceIndex(places.means.shape[1], len(places))
        self._index.upsert(places)

    def search(self, query: EncodedDrive, scan: int, tolerance_m: float) -> tuple[bool, bool]:
        """Whether the answer to a scan is wrong, and whether there is a right one."""
        away_m = np.hypot(*(self._positions_m - query.poses[scan, :2]).T)
        wrong = True
        if query.usable[scan]:
            nearest = self._index.search(query.means[scan], 1)[0]
            wrong = bool(away_m[nearest.place_id] > tolerance_m)
        return wrong, bool(away_m.min() <= tolerance_m)
