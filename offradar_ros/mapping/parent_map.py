"""Algorithm 1 of the paper: one scan into the parent map.

What the algorithm's listing leaves open or contradicts in the text is resolved so:

* Line 6 replaces the *more* certain scan; text and figures say that the lower uncertainty stays. Lower U replaces.
* One scan would overwrite every match and so fill the map with copies of itself: `map.replace` is `nearest`, or
  `worst`, or `all` as printed.
* Line 7 leaves D_i behind: pose, stamp and session move with the embedding.
* A scan that matches nothing becomes a place, unless `map.insert_unmatched` is false (the paper's constant size).
* D_t is measured horizontally: the altitudes of two drives differ by metres through GPS alone.
"""

from __future__ import annotations

import dataclasses
import enum
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import MapConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.mapping.grid import PositionGrid
from offradar_ros.mapping.place_columns import PlaceColumns, place_of, take_rows
from offradar_ros.types import Embedding, Place, PlaceTable, Pose

FARTHEST_M = 1e8
"""A coordinate beyond this is no place on Earth, whatever the frame's origin."""


class MergeKind(str, enum.Enum):
    """What became of one scan."""

    INSERTED = 'inserted'
    REPLACED = 'replaced'
    KEPT = 'kept'


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Merge:
    """Outcome of one scan.

    Attributes:
        kind: whether the scan became a place, replaced some, or left the map as it was.
        place_ids: the places that now hold the scan, nearest first; empty when kept.
        before: what those places held until now; empty unless replaced.
    """

    kind: MergeKind
    place_ids: tuple[int, ...] = ()
    before: tuple[Place, ...] = ()


class ParentMap:
    """The places, each with the most certain scan seen there. One thread at a time."""

    def __init__(self, config: MapConfig, dimension: int) -> None:
        self.config = config
        self.dimension = dimension
        self.next_place_id = 0
        self._columns = PlaceColumns(dimension)
        self._anchors_m = np.empty((16, 2), np.float64)
        self._grid = PositionGrid(config.match_distance_m)

    def merge(self, embedding: Embedding, pose: Pose, session_id: int) -> Merge:
        """Algorithm 1 for the new scan (μ_j, U_j) taken at D_j.

        Raises RefusedInput (`invalid_embedding`, `invalid_position`) and leaves the map as it was.
        """
        scan = self._scan(embedding, pose, session_id)
        # Find matched scan index (lines 1 to 4).
        matched = self._find_matched(pose)
        if not len(matched):
            return self._insert(scan) if self.config.insert_unmatched else Merge(MergeKind.KEPT)
        uncertainties = self._get_uncertainty(matched)
        # Uncertainty comparison and replacement (lines 5 to 9).
        compared = self._compared(uncertainties)
        replaced = compared[scan.uncertainty < uncertainties[compared] - self.config.replace_margin]
        return self._replace(matched[replaced], scan) if len(replaced) else Merge(MergeKind.KEPT)

    def _scan(self, embedding: Embedding, pose: Pose, session_id: int) -> Place:
        problem = embedding_problem(embedding)
        if problem is None and embedding.mean.size != self.dimension:
            problem = f'expected the dimension of the map, {self.dimension}, got {embedding.mean.size}'
        if problem:
            raise RefusedInput('invalid_embedding', f'embedding at {embedding.stamp_ns} ns: {problem}')
        if not all(abs(v) <= FARTHEST_M for v in (pose.x_m, pose.y_m, pose.z_m)):
            raise RefusedInput(
                'invalid_position',
                f'position of the scan at {embedding.stamp_ns} ns: expected finite metres within ±{FARTHEST_M:g}, '
                f'got {pose.x_m}, {pose.y_m}, {pose.z_m}',
            )
        # U is kept in single precision; rounded before it is compared, a scan never replaces itself.
        uncertainty = float(np.float32(embedding.uncertainty))
        mean = np.asarray(embedding.mean, np.float32)
        return Place(self.next_place_id, session_id, embedding.stamp_ns, pose, uncertainty, mean)

    def _find_matched(self, pose: Pose) -> NDArray[np.intp]:
        """Rows of the places within D_t, nearest first, the older first of equally near ones."""
        rows = np.array(sorted(self._grid.near(pose.x_m, pose.y_m, self.config.match_distance_m)), np.intp)
        offsets = self._match_positions(rows) - (pose.x_m, pose.y_m)
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        order = np.argsort(distances, kind='stable')
        return rows[order[distances[order] < self.config.match_distance_m]]

    def _match_positions(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """(N, 2) positions that D_t is measured to.

        With `pose` a place follows the scan it holds, and successively more certain scans of one drive can drag it
        along the road and leave any length of road without a place. With `anchor` it stays: whatever was merged at
        a position, a scan within 2·D_t of it is in the map.
        """
        anchored = self.config.match_position == 'anchor'
        return self._anchors_m[rows] if anchored else self._columns.table.positions_m[rows, :2]

    def _get_uncertainty(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._columns.table.uncertainties[rows].astype(np.float64)

    def _compared(self, uncertainties: NDArray[np.float64]) -> NDArray[np.intp]:
        """Which of the matches, nearest first, the scan may replace."""
        if self.config.replace == 'all':
            return np.arange(len(uncertainties))
        return np.array([0 if self.config.replace == 'nearest' else np.argmax(uncertainties)], np.intp)

    def _insert(self, scan: Place) -> Merge:
        row = len(self._columns)
        self._columns.upsert(PlaceTable.from_places([scan], self.dimension))
        self._set_anchors(row, np.array([(scan.pose.x_m, scan.pose.y_m)]))
        self._grid.add(row, scan.pose.x_m, scan.pose.y_m)
        self.next_place_id += 1
        return Merge(MergeKind.INSERTED, (scan.place_id,))

    def _replace(self, rows: NDArray[np.intp], scan: Place) -> Merge:
        before = tuple(place_of(self._columns.table, int(row)) for row in rows)
        self.restore([dataclasses.replace(scan, place_id=old.place_id) for old in before])
        return Merge(MergeKind.REPLACED, tuple(old.place_id for old in before), before)

    def restore(self, places: list[Place]) -> None:
        """Overwrite known places with other content; their anchors stay."""
        table = PlaceTable.from_places(places, self.dimension)
        rows = self._rows(table.place_ids)
        if self.config.match_position == 'pose':
            for row, place in zip(rows.tolist(), places, strict=True):
                self._grid.remove(row, *self._columns.table.positions_m[row, :2].tolist())
                self._grid.add(row, place.pose.x_m, place.pose.y_m)
        self._columns.upsert(table)

    def remove(self, place_ids: list[int]) -> None:
        """Take places away; only the newest can be, as when what added them last is undone."""
        ids = np.array(sorted(place_ids), np.int64)
        first = len(self) - len(ids)
        if not np.array_equal(self._rows(ids), np.arange(first, len(self))):
            raise ValueError(f'places {place_ids} are not the newest {len(ids)} of the map')
        for row, (x_m, y_m) in enumerate(self._match_positions(np.arange(first, len(self))).tolist(), start=first):
            self._grid.remove(row, x_m, y_m)
        self._columns.remove(ids)

    def load(self, places: PlaceColumns, anchors_m: NDArray[np.float64], next_place_id: int) -> None:
        """Fill an empty map with stored places, which are the map's from here on; `anchors_m` (N, 2)."""
        if len(self):
            raise ValueError('a map is loaded into an empty one only')
        self._columns = places
        self._set_anchors(0, anchors_m)
        self.next_place_id = next_place_id
        self._grid.fill(self._match_positions(np.arange(len(self))))

    def _set_anchors(self, row: int, anchors_m: NDArray[np.float64]) -> None:
        end = row + len(anchors_m)
        if end > len(self._anchors_m):
            grown = np.empty((max(end, 2 * len(self._anchors_m)), 2), np.float64)
            grown[:row] = self._anchors_m[:row]
            self._anchors_m = grown
        self._anchors_m[row:end] = anchors_m

    def _rows(self, place_ids: NDArray[np.int64]) -> NDArray[np.intp]:
        rows, known = self._columns.find(place_ids)
        if not known.all():
            raise KeyError(f'no place {int(place_ids[~known][0])} in the map')
        return rows

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def mean_uncertainty(self) -> float:
        """Mean U over the places; NaN for an empty map."""
        return float(np.mean(self._columns.table.uncertainties, dtype=np.float64)) if len(self) else math.nan

    @property
    def view(self) -> PlaceTable:
        """Every place, in ascending order of id, without a copy: valid until the next change."""
        return self._columns.table

    def table(self) -> PlaceTable:
        """A copy of every place, in ascending order of id."""
        return take_rows(self._columns.table, np.arange(len(self)))

    def rows(self, place_ids: tuple[int, ...] | list[int]) -> PlaceTable:
        """A copy of these places, in this order; KeyError for one that is not in the map."""
        return take_rows(self._columns.table, self._rows(np.array(place_ids, np.int64)))

    def place(self, place_id: int) -> Place:
        """One place; KeyError if it is not in the map."""
        return place_of(self._columns.table, int(self._rows(np.array([place_id], np.int64))[0]))

    def anchors(self, place_ids: list[int]) -> NDArray[np.float64]:
        """(N, 2) positions east and north where these places were first mapped, metres."""
        return self._anchors_m[self._rows(np.array(place_ids, np.int64))]
