"""Drives of one road searched in halves of each other's maps, so that about half of the scans are off the map."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.aligned_places import AlignedPlaces, joined_places
from offradar_ros.calibration.encoded_drive import EncodedDrive
from offradar_ros.calibration.open_set import halves, joined_evidence, open_answers
from offradar_ros.calibration.road_alignments import RoadAlignments
from offradar_ros.calibration.stretches import squares, stretches
from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import DataError
from offradar_ros.retrieval.confidence import log_odds
from offradar_ros.retrieval.evidence import EvidenceTable

HALVINGS = 3
"""The ground is cut into 2³ stretches. What judges the scans of one was learned from those of the others."""


class Judged(NamedTuple):
    """(R,) float64 log-odds that each answer is right, and whether it is."""

    log_odds: NDArray[np.float64]
    right: NDArray[np.bool_]


@dataclasses.dataclass(frozen=True, eq=False)
class LeftOutQueries:
    """R rows, two for each usable scan: in one half of the map of another drive, and in the other half.

    Attributes:
        drives, refused: number of drives, and of their scans that the encoder refused.
        evidence: R rows.
        right: (R,) whether the nearest place in embedding space is within the tolerance of the scan.
        on_map: (R,) whether any place of that half is.
        scan: (R,) int64, number of the scan.
        in_turn: (R,) whether this is the half that the scan takes in turn with the next one.
        stretch, square: (R,) int64, on which part of the ground the scan was taken; drives share them.
        aligned: the nearest places of the R rows, aligned with the scan; None if they are not.
    """

    drives: int
    refused: int
    evidence: EvidenceTable
    right: NDArray[np.bool_]
    on_map: NDArray[np.bool_]
    scan: NDArray[np.int64]
    in_turn: NDArray[np.bool_]
    stretch: NDArray[np.int64]
    square: NDArray[np.int64]
    aligned: AlignedPlaces | None = None

    def __len__(self) -> int:
        return len(self.right)

    def judged(self, coefficients: ConfidenceConfig) -> Judged:
        """The answers by these coefficients: with alignments, if there are any, else by distance alone."""
        if self.aligned is None:
            return Judged(log_odds(self.evidence, coefficients), self.right)
        firsts = self.aligned.firsts(coefficients)
        return Judged(firsts.log_odds, firsts.right)

    @property
    def scans(self) -> int:
        """Number of scans, with the refused ones."""
        return len(np.unique(self.scan)) + self.refused

    @property
    def mixed(self) -> NDArray[np.intp]:
        """One row of each scan, about half of them off the map: two rows of a scan depend on each other."""
        return np.flatnonzero(self.in_turn)

    @property
    def off_map(self) -> NDArray[np.intp]:
        """One row of each scan that is off the map in one half or in both."""
        rows = np.flatnonzero(~self.on_map)
        return rows[np.unique(self.scan[rows], return_index=True)[1]]


def left_out_queries(
    drives: Sequence[EncodedDrive], spacing_m: float, tolerance_m: float, alignments: RoadAlignments | None = None
) -> LeftOutQueries:
    """Search both halves of every drive's map, a place every `spacing_m`, for scans of every other drive.

    Scan i is searched in the map of other drive i, modulo their number, as in `validation_queries`. With `alignments`,
    it is aligned with the nearest places. DataError where no scan is off the map, or every one is: the road is too
    short to leave a half of it out.
    """
    found, scans, in_turn, positions, aligned = [], [], [], [], []
    first = 0
    for number, query in enumerate(drives):
        usable = np.flatnonzero(query.usable)
        others = [*drives[:number], *drives[number + 1 :]]
        for turn, mapped in enumerate(others):
            chosen = np.arange(turn, len(usable), len(others))
            rows = usable[chosen]
            for side, kept in enumerate(halves(mapped.driven_m, mapped.map_rows(spacing_m))):
                if not len(rows) or not len(kept):
                    continue
                places, positions_m = mapped.places(kept), query.poses[rows, :2]
                found.append(
                    open_answers(places, query.means[rows], query.uncertainties[rows], positions_m, tolerance_m)
                )
                if alignments is not None:
                    aligned.append(alignments.aligned(drives.index(mapped), kept, number, rows, tolerance_m))
                scans.append(first + chosen)
                in_turn.append(chosen // len(others) % 2 == side)
                positions.append(positions_m)
        first += len(usable)
    on_map = np.concatenate([part.on_map for part in found])
    if on_map.all() or not on_map.any():
        raise DataError(
            f'{", ".join(drive.name for drive in drives)}: with a half of each map left out, expected scans within '
            f'{tolerance_m:g} m of the rest and scans beyond, got {int(on_map.sum())} of {len(on_map)} within: drive '
            'further'
        )
    ground_m = np.concatenate(positions)
    return LeftOutQueries(
        len(drives),
        sum(int(np.sum(~drive.usable)) for drive in drives),
        joined_evidence([part.evidence for part in found]),
        np.concatenate([part.right for part in found]),
        on_map,
        np.concatenate(scans).astype(np.int64),
        np.concatenate(in_turn),
        stretches(ground_m, HALVINGS),
        squares(ground_m),
        joined_places(aligned) if aligned else None,
    )
