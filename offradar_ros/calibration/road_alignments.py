"""The nearest places of the drives of one road, aligned with their scans as the query node does it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.aligned_places import AlignedPlaces
from offradar_ros.calibration.aligned_search import AlignedSearch
from offradar_ros.calibration.drive_signatures import DriveSignatures, Scans
from offradar_ros.calibration.encoded_drive import EncodedDrive


class RoadAlignments:
    """Signatures of the drives, and searches of maps that are made of them. Not thread-safe.

    Args:
        drives: the drives.
        scans: for each drive, all scans of its recording.
        rows: for each drive, (N,) which of these its own scans are.
        places: how many are aligned with each scan.
        advance: called with the number of scans that have been aligned.
    """

    def __init__(
        self,
        drives: Sequence[EncodedDrive],
        scans: Sequence[Scans],
        rows: Sequence[NDArray[np.intp]],
        places: int,
        advance: Callable[[int], None] = lambda _: None,
    ) -> None:
        self._drives, self._scans, self._rows, self._places = drives, scans, rows, places
        self._signatures, self._advance, self._done = DriveSignatures(scans), advance, 0

    def aligned(
        self, mapped: int, map_rows: NDArray[np.intp], query: int, rows: NDArray[np.intp], tolerance_m: float
    ) -> AlignedPlaces:
        """(Q,) scans of one drive, by the drives' numbers, in the map of (P,) scans of another."""
        drive = self._drives[mapped]
        session = np.full(len(map_rows), mapped, np.int32)
        table = dataclasses.replace(drive.places(map_rows), session_ids=session)
        search = AlignedSearch(table, self._signatures, self._places, tolerance_m)
        asked, found = self._drives[query], []
        for row in rows.tolist():
            signature = self._signatures.of(self._scans[query], int(self._rows[query][row]))
            uncertainty = float(asked.uncertainties[row])
            found.append(search.nearest(int(asked.stamps_ns[row]), asked.means[row], uncertainty, signature))
            self._done += 1
            self._advance(self._done)
        return search.judged(found, asked.poses[rows, :2])
