"""Searches for each drive in the maps of all other drives through its world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.recordings.spacing import subsample_by_distance

TOLERANCE_M = 25.0
NO_OTHER_PLACE = 2.0
"""Margin without a wrong place: that of a unit descriptor equal to the right place and opposite to a wrong one."""


class Search(NamedTuple):
    """The search for one drive in the map of another.

    Attributes:
        queried: number of the drive whose scans are the queries.
        queries: (Q,) the scans of that drive with a place within the tolerance.
        margins: (Q,) float64, half the difference of two squared descriptor distances: to the nearest place beyond the
            tolerance, and to the nearest place within it. For unit descriptors it is a difference of cosines. It is
            above 0 if the answer is right, and `NO_OTHER_PLACE` if no place is beyond the tolerance.
    """

    queried: int
    queries: NDArray[np.intp]
    margins: NDArray[np.float64]


def search_pairs(
    drives: Sequence[Drive], descriptors: Sequence[NDArray[np.floating]], spacing_m: float
) -> list[Search]:
    """A search for each ordered pair of drives of one world.

    `descriptors` are (N, d) for each drive; maps are subsampled by `spacing_m` metres driven.
    """
    return [
        _search(queried, drives[mapped], descriptors[mapped], drives[queried], descriptors[queried], spacing_m)
        for mapped in range(len(drives))
        for queried in range(len(drives))
        if mapped != queried and drives[mapped].world == drives[queried].world
    ]


def _search(
    number: int,
    mapped: Drive,
    map_descriptors: NDArray[np.floating],
    queried: Drive,
    descriptors: NDArray[np.floating],
    spacing_m: float,
) -> Search:
    driven_m = np.cumsum(np.hypot(*np.diff(mapped.poses[:, :2], axis=0, prepend=mapped.poses[:1, :2]).T))
    places = subsample_by_distance(driven_m, spacing_m)
    right = np.linalg.norm(queried.poses[:, None, :2] - mapped.poses[None, places, :2], axis=-1) <= TOLERANCE_M
    queries = np.flatnonzero(right.any(axis=1))
    candidates, right = map_descriptors[places], right[queries]
    # −|a − b|² / 2 without the term of the query alone, which is the same for all places.
    similarity = descriptors[queries] @ candidates.T - 0.5 * np.sum(candidates**2, axis=1)
    nearest_right = np.where(right, similarity, -np.inf).max(axis=1, initial=-np.inf)
    nearest_wrong = np.where(right, -np.inf, similarity).max(axis=1, initial=-np.inf)
    margins = np.where(right.all(axis=1), NO_OTHER_PLACE, nearest_right - nearest_wrong)
    return Search(number, queries, np.asarray(margins, np.float64))
