"""Scans on and off the map: a half of the road is left out of the map, so that its scans are truly off it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.retrieval.evidence import EvidenceTable, evidence_table
from offradar_ros.types import PlaceTable

_BLOCK = 256
"""Number of scans whose distances on the ground to all places are in memory at once."""


class OpenAnswers(NamedTuple):
    """Scans searched in a map that need not hold their place.

    Attributes:
        evidence: one row for each of Q scans.
        right: (Q,) whether the nearest place in embedding space is within the tolerance of the scan.
        on_map: (Q,) whether any place is.
    """

    evidence: EvidenceTable
    right: NDArray[np.bool_]
    on_map: NDArray[np.bool_]


def halves(driven_m: NDArray[np.float64], rows: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Those of `rows` on the first half of a drive, and those on the second; (N,) `driven_m` of its scans."""
    return by_turns(driven_m, rows, float(driven_m[-1] - driven_m[0]) / 2.0)


def by_turns(
    driven_m: NDArray[np.float64], rows: NDArray[np.intp], stretch_m: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Those of `rows` on the 1st, 3rd, … stretch of a drive, and those on the others; (N,) `driven_m` of its scans."""
    at_m = driven_m - driven_m[0]
    # The end of the last stretch belongs to it.
    last = max(math.ceil(at_m[-1] / stretch_m), 1) - 1 if stretch_m > 0.0 else 0
    odd = np.minimum(np.floor(at_m[rows] / max(stretch_m, 1e-9)), last) % 2 == 1
    return rows[~odd], rows[odd]


def open_answers(
    places: PlaceTable,
    means: NDArray[np.float32],
    uncertainties: NDArray[np.float64],
    positions_m: NDArray[np.float64],
    tolerance_m: float,
) -> OpenAnswers:
    """Search a map of one or more places for (Q, d) finite means, with (Q,) U, of scans at (Q, 2) positions."""
    evidence = evidence_table(places, means, uncertainties, tolerance_m)
    chosen_m, nearest_m = np.empty((2, len(means)))
    for start in range(0, len(means), _BLOCK):
        part = slice(start, start + _BLOCK)
        offsets_m = places.positions_m[:, :2] - positions_m[part, np.newaxis]
        away_m = np.hypot(offsets_m[..., 0], offsets_m[..., 1])
        chosen_m[part] = away_m[np.arange(len(away_m)), evidence.nearest[part]]
        nearest_m[part] = away_m.min(axis=1)
    return OpenAnswers(evidence, chosen_m <= tolerance_m, nearest_m <= tolerance_m)


def joined_evidence(tables: Sequence[EvidenceTable]) -> EvidenceTable:
    """The rows of all tables, one after another; `nearest` remains a row of each one's own map."""
    columns = [
        np.concatenate([getattr(table, field.name) for table in tables]) for field in dataclasses.fields(EvidenceTable)
    ]
    return EvidenceTable(*columns)
