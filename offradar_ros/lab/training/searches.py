"""Every drive searched for in the maps of all others through its world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.recordings.spacing import subsample_by_distance

TOLERANCE_M = 25.0
NO_OTHER_PLACE = 2.0
"""As of a unit descriptor that is found exactly, beside a place that is its opposite."""


class Search(NamedTuple):
    """One drive searched for in the map of another.

    Attributes:
        driven: number of the drive whose scans are searched for.
        queries: (Q,) its scans that have a place within the tolerance.
        margins: (Q,) how much nearer the nearest place within the tolerance is than the nearest one beyond it, as half
            the difference of squared distances (of cosines, for unit descriptors): above 0 where the answer is right.
            Where there is no place beyond it, `NO_OTHER_PLACE`.
    """

    driven: int
    queries: NDArray[np.intp]
    margins: NDArray[np.float64]


def searches(drives: Sequence[Drive], descriptors: Sequence[NDArray[np.floating]], spacing_m: float) -> list[Search]:
    """All ordered pairs of drives of one world; descriptors (N, d) of each, and one scan mapped in `spacing_m`."""
    return [
        _search(driven, drives[mapped], descriptors[mapped], drives[driven], descriptors[driven], spacing_m)
        for mapped in range(len(drives))
        for driven in range(len(drives))
        if mapped != driven and drives[mapped].world == drives[driven].world
    ]


def _search(
    number: int,
    mapped: Drive,
    map_descriptors: NDArray[np.floating],
    driven: Drive,
    descriptors: NDArray[np.floating],
    spacing_m: float,
) -> Search:
    driven_m = np.cumsum(np.hypot(*np.diff(mapped.poses[:, :2], axis=0, prepend=mapped.poses[:1, :2]).T))
    places = subsample_by_distance(driven_m, spacing_m)
    right = np.linalg.norm(driven.poses[:, None, :2] - mapped.poses[None, places, :2], axis=-1) <= TOLERANCE_M
    queries = np.flatnonzero(right.any(axis=1))
    candidates, right = map_descriptors[places], right[queries]
    # −|a − b|² / 2 without the term of the query alone, which orders nothing.
    likeness = descriptors[queries] @ candidates.T - 0.5 * np.sum(candidates**2, axis=1)
    found = np.where(right, likeness, -np.inf).max(axis=1, initial=-np.inf)
    mistaken = np.where(right, -np.inf, likeness).max(axis=1, initial=-np.inf)
    margins = np.where(right.all(axis=1), NO_OTHER_PLACE, found - mistaken)
    return Search(number, queries, np.asarray(margins, np.float64))
