"""The evidence for the answers to many queries at once, as arrays."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import PlaceTable

_BLOCK = 256
"""Number of queries whose distances to all places are in memory at once."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class EvidenceTable:
    """Columns of `types.Evidence`, one row for each of Q queries.

    Attributes:
        nearest: (Q,) int64, row of the nearest place in the map.
        distance, distance_apart, place_distance_apart: (Q,) float64, in embedding space; infinite where there is none.
        uncertainty, place_uncertainty: (Q,) float64.
    """

    nearest: NDArray[np.int64]
    distance: NDArray[np.float64]
    distance_apart: NDArray[np.float64]
    place_distance_apart: NDArray[np.float64]
    uncertainty: NDArray[np.float64]
    place_uncertainty: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.distance)


def evidence_table(
    places: PlaceTable,
    means: NDArray[np.float32],
    uncertainties: NDArray[np.float64],
    tolerance_m: float,
    exclude: NDArray[np.bool_] | None = None,
) -> EvidenceTable:
    """What `MapSearch.evidence` gives for each of (Q, d) finite means with (Q,) U, from a map of one or more places.

    The ids of `places` are ascending. `exclude` (Q, N) is true where a place is not searched for a query.
    """
    index = PlaceIndex(places.means.shape[1], len(places))
    index.upsert(places)
    nearest, distance = (column[:, 0] for column in index.search_many(means, 1, exclude))
    nearest = nearest.astype(np.int64)
    # Queries share their nearest places, unless each has places of its own that are not searched.
    found, of_query = np.unique(nearest, return_inverse=True) if exclude is None else (nearest, np.arange(len(nearest)))
    return EvidenceTable(
        nearest,
        distance.astype(np.float64),
        _distances_apart(index, places, means, nearest, tolerance_m, exclude),
        _distances_apart(index, places, places.means[found], found, tolerance_m, exclude)[of_query],
        uncertainties,
        places.uncertainties[nearest].astype(np.float64),
    )


def _distances_apart(
    index: PlaceIndex,
    places: PlaceTable,
    means: NDArray[np.float32],
    nearest: NDArray[np.int64],
    tolerance_m: float,
    exclude: NDArray[np.bool_] | None,
) -> NDArray[np.float64]:
    """(Q,) distances from means (Q, d) to the nearest place more than the tolerance away from place `nearest` (Q,)."""
    apart = np.full(len(means), np.inf)
    for start in range(0, len(means), _BLOCK):
        part = slice(start, start + _BLOCK)
        near = np.stack([index.rows_within(places.positions_m[row], tolerance_m) for row in nearest[part].tolist()])
        near = near if exclude is None else near | exclude[part]
        apart[part] = index.search_many(means[part], 1, near)[1][:, 0]
    return apart
