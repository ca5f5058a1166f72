"""What one drive's scans find in another drive's map, and whether it is right."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.evaluation.neighbours import nearest
from offradar_ros.evaluation.spacing import one_a_cell

DEPTH = 10
"""So many nearest places are judged."""

NOT_FOUND = 1_000_000
"""Rank where none of them is right."""


@dataclasses.dataclass(frozen=True)
class Pair:
    """Which drive searched which: `map_index` and `query_index` are drives of `world`."""

    method: str
    group: str
    world: str
    map_index: int
    query_index: int
    spacing_m: float


@dataclasses.dataclass(frozen=True, eq=False)
class Answers:
    """One row for each of Q query scans.

    Attributes:
        pair: who searched whom.
        places: size of the map.
        uncertainties: (Q,) float64, infinite where the encoder refused the scan.
        ranks: (Q,) int, 0 where the nearest place is right, and so on; `NOT_FOUND` beyond `DEPTH`.
        positive: (Q,) whether the map holds a right place at all.
        errors_m: (Q,) metres from the nearest place in embedding space to where the scan was taken.
        distances: (Q,) distance of that place in embedding space.
        kinds: (Q,) what is wrong with the scan; empty for clean ones.
        severities: (Q,) how badly, 0 to 1.
    """

    pair: Pair
    places: int
    uncertainties: NDArray[np.float64]
    ranks: NDArray[np.int64]
    positive: NDArray[np.bool_]
    errors_m: NDArray[np.float64]
    distances: NDArray[np.float64]
    kinds: NDArray[np.str_]
    severities: NDArray[np.float64]

    @property
    def correct(self) -> NDArray[np.bool_]:
        """(Q,) whether the nearest place is right."""
        right: NDArray[np.bool_] = self.ranks == 0
        return right


def map_rows(drive: EmbeddedDrive, spacing_m: float) -> NDArray[np.intp]:
    """Scans of a drive that a map with a place every `spacing_m` holds; refused ones are passed over."""
    usable = np.flatnonzero(drive.usable)
    return usable[one_a_cell(drive.drive.driven_m[usable], spacing_m)]


def answers(
    pair: Pair,
    means: NDArray[np.float32],
    positions_m: NDArray[np.float64],
    query: EmbeddedDrive,
    tolerance_m: float,
) -> Answers:
    """Search (P, d) places at (P, 2) positions for every scan of `query`."""
    truth = query.drive.poses[:, :2]
    rows, distances = nearest(query.means, means, DEPTH)
    errors_m = np.linalg.norm(positions_m[rows] - truth[:, None], axis=2)
    right = (errors_m <= tolerance_m) & query.usable[:, None]
    ranks = np.where(right.any(axis=1), np.argmax(right, axis=1), NOT_FOUND)
    reach_m = np.array([np.hypot(*(positions_m - place).T).min(initial=np.inf) for place in truth])
    return Answers(
        pair,
        len(means),
        query.uncertainties,
        ranks.astype(np.int64),
        reach_m <= tolerance_m,
        errors_m[:, 0],
        distances[:, 0],
        query.drive.kinds,
        query.drive.severities,
    )


def answers_from(pair: Pair, mapped: EmbeddedDrive, query: EmbeddedDrive, tolerance_m: float) -> Answers:
    """Search the map made of one drive for another's scans."""
    rows = map_rows(mapped, pair.spacing_m)
    return answers(pair, mapped.means[rows], mapped.drive.poses[rows, :2], query, tolerance_m)
