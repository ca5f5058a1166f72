"""Drives of one road searched in each other's maps: which answers are wrong, and how uncertain each scan was."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.answers import Pair, Rules, answers, map_rows, places_of
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive

SQUARE_M = 100.0
"""Answers within one such square of ground go right or wrong together more often than those of two."""


@dataclasses.dataclass(frozen=True, eq=False)
class ValidationQueries:
    """One row for each of Q scans, of all drives.

    Attributes:
        drives: how many.
        uncertainties: (Q,) float64, infinite where the encoder refused the scan.
        wrong: (Q,) whether the nearest place is no right one.
        positive: (Q,) whether the map held a right place at all.
        squares: (Q,) int64, which square of `SQUARE_M` of ground the scan was taken in, whatever the drive.
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
        """Scans that the encoder refused."""
        return int(np.sum(~np.isfinite(self.uncertainties)))


def validation_queries(drives: Sequence[EmbeddedDrive], spacing_m: float, tolerance_m: float) -> ValidationQueries:
    """Search every drive's map, a place every `spacing_m`, for scans of every other drive of its world.

    Each scan counts once: searched in several maps it would be right or wrong in most of them alike, and the bounds
    would take that for so many scans. Those of a drive are dealt in turn to the maps of the others. DataError for a
    drive without a usable scan, and where no scan has a right place in any map.
    """
    for drive in drives:
        if not drive.usable.any():
            raise DataError(f'{drive.drive.name}: none of its {len(drive.drive)} scans can be encoded')
    wrong, positive = [], []
    for query in drives:
        told = [_searched(mapped, query, spacing_m, tolerance_m) for mapped in drives if mapped is not query]
        scans = np.arange(len(query.drive))
        dealt = scans % len(told)
        wrong.append(np.stack([w for w, _ in told])[dealt, scans])
        positive.append(np.stack([p for _, p in told])[dealt, scans])
    if not any(found.any() for found in positive):
        raise DataError(
            f'{", ".join(d.drive.name for d in drives)}: no scan is within {tolerance_m:g} m of another drive: '
            'expected drives of one road'
        )
    corners = np.floor(np.concatenate([query.drive.poses[:, :2] for query in drives]) / SQUARE_M)
    return ValidationQueries(
        len(drives),
        np.concatenate([query.uncertainties for query in drives]),
        np.concatenate(wrong),
        np.concatenate(positive),
        np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64),
    )


def _searched(
    mapped: EmbeddedDrive, query: EmbeddedDrive, spacing_m: float, tolerance_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which answers are wrong, and which scans have a right place."""
    drive = mapped.drive
    pair = Pair('', drive.group, drive.world, drive.index, query.drive.index, spacing_m)
    places = places_of(mapped, map_rows(mapped, spacing_m))
    found = answers(pair, places, query, Rules(tolerance_m, tolerance_m))
    return ~found.correct, found.positive
