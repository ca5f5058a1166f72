"""Algorithm 1 of the paper: one scan into the parent map.

Where the algorithm's listing is incomplete or contradicts the text, we decide as follows:

* Line 6 replaces the *more* certain scan; text and figures keep the lower uncertainty. Here the lower U replaces.
* One scan would overwrite every match and so fill the map with copies of itself: `map.replace` is `nearest`, or
  `worst`, or `all` as printed.
* Line 7 does not update D_i; here pose, stamp and session are replaced together with the embedding.
* A scan that matches nothing becomes a place, unless `map.insert_unmatched` is false (the paper's constant size).
* D_t is a horizontal distance: GPS altitudes of two drives differ by metres.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import MapConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.mapping.grid import PositionGrid
from offradar_ros.mapping.place_check import MAX_COORDINATE_M, valid_means, valid_positions
from offradar_ros.mapping.place_columns import PlaceColumns, place_of, take_rows
from offradar_ros.types import Embedding, Place, PlaceTable, Pose


class MergeKind(str, enum.Enum):
    """What a merge did with one scan."""

    INSERTED = 'inserted'
    REPLACED = 'replaced'
    KEPT = 'kept'


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Merge:
    """Outcome of one scan.

    Attributes:
        kind: whether the scan was inserted, replaced the content of places, or left the map unchanged.
        place_ids: the places that now hold the scan, nearest first; empty for KEPT.
        before: what those places held before, in the same order; empty unless REPLACED.
    """

    kind: MergeKind
    place_ids: tuple[int, ...] = ()
    before: tuple[Place, ...] = ()


class Merges(NamedTuple):
    """Outcome of S scans that were merged one after the other.

    Attributes:
        kinds: S kinds, one for each scan.
        nearest: (S,) int64 id of the place nearest to each scan within D_t before it was merged, −1 where there was
            none. Only scans with such a place can replace.
    """

    kinds: tuple[MergeKind, ...]
    nearest: NDArray[np.int64]


def _refuse_invalid_position(stamp_ns: int, position_m: Sequence[float]) -> None:
    if not all(abs(value) <= MAX_COORDINATE_M for value in position_m):
        raise RefusedInput(
            'invalid_position',
            f'position of the scan at {stamp_ns} ns: expected finite metres within ±{MAX_COORDINATE_M:g}, '
            f'got {", ".join(map(str, position_m))}',
        )


class ParentMap:
    """The places, each with the most certain scan that was merged there. Not thread-safe."""

    def __init__(self, config: MapConfig, dimension: int) -> None:
        self.config = config
        self.dimension = dimension
        self.next_place_id = 0
        self._columns = PlaceColumns(dimension)
        self._anchors_m = np.empty((16, 2), np.float64)
        self._grid = PositionGrid(config.match_distance_m)

    def merge(self, embedding: Embedding, pose: Pose, session_id: int) -> Merge:
        """Algorithm 1 for the new scan (μ_j, U_j) taken at D_j.

        Raises RefusedInput (`invalid_embedding`, `invalid_position`) and leaves the map unchanged.
        """
        scan = self._scan(embedding, pose, session_id)
        # Find matched scan index (lines 1 to 4).
        matched = self._find_matched(pose.x_m, pose.y_m)
        if not matched:
            return Merge(MergeKind.INSERTED, (self._insert(scan),)) if self._inserts else Merge(MergeKind.KEPT)
        # Uncertainty comparison and replacement (lines 5 to 9).
        replaced = self._less_certain(matched, float(scan.uncertainties[0]))
        if not replaced:
            return Merge(MergeKind.KEPT)
        before = tuple(place_of(self.view, row) for row in replaced)
        self._replace(replaced, scan)
        return Merge(MergeKind.REPLACED, tuple(place.place_id for place in before), before)

    def merge_all(self, scans: PlaceTable, session_id: int) -> Merges:
        """`merge` of many scans one after the other, faster: all are checked first, and replaced content is not kept.

        Args:
            scans: (S, d) means, U, poses and stamps of the scans, in merge order; their place and session ids are
                ignored.
            session_id: session of all scans.

        Raises RefusedInput as `merge` does, and leaves the map unchanged, if any of the scans is invalid.
        """
        self._refuse_invalid_scans(scans)
        scans = dataclasses.replace(scans, session_ids=np.full(len(scans), session_id, np.int32))
        kinds, nearest = [MergeKind.KEPT] * len(scans), np.full(len(scans), -1, np.int64)
        positions_m, uncertainties = scans.positions_m[:, :2].tolist(), scans.uncertainties.tolist()
        for index, ((x_m, y_m), uncertainty) in enumerate(zip(positions_m, uncertainties, strict=True)):
            matched = self._find_matched(x_m, y_m)
            if matched:
                nearest[index] = self.view.place_ids[matched[0]]
                replaced = self._less_certain(matched, uncertainty)
                if replaced:
                    self._replace(replaced, take_rows(scans, slice(index, index + 1)))
                    kinds[index] = MergeKind.REPLACED
            elif self._inserts:
                self._insert(take_rows(scans, slice(index, index + 1)))
                kinds[index] = MergeKind.INSERTED
        return Merges(tuple(kinds), nearest)

    @property
    def _inserts(self) -> bool:
        return self.config.insert_unmatched

    def check(self, embedding: Embedding) -> None:
        """RefusedInput('invalid_embedding') for one that cannot be merged, whatever its position."""
        problem = embedding_problem(embedding)
        if problem is None and embedding.mean.size != self.dimension:
            problem = f'expected the dimension of the map, {self.dimension}, got {embedding.mean.size}'
        if problem:
            raise RefusedInput('invalid_embedding', f'embedding at {embedding.stamp_ns} ns: {problem}')

    def _scan(self, embedding: Embedding, pose: Pose, session_id: int) -> PlaceTable:
        """The scan as a table of one row, not yet a place."""
        self.check(embedding)
        _refuse_invalid_position(embedding.stamp_ns, (pose.x_m, pose.y_m, pose.z_m))
        # U is stored in single precision. It is rounded before the comparison, so that a scan never replaces itself.
        scan = Place(-1, session_id, embedding.stamp_ns, pose, embedding.uncertainty, embedding.mean)
        return PlaceTable.from_places([scan], self.dimension)

    def _refuse_invalid_scans(self, scans: PlaceTable) -> None:
        if scans.means.shape != (len(scans), self.dimension):
            raise RefusedInput(
                'invalid_embedding',
                f'expected means of shape ({len(scans)}, {self.dimension}) as in the map, got {scans.means.shape}',
            )
        usable = valid_means(scans.means) & np.isfinite(scans.uncertainties) & (scans.uncertainties >= 0.0)
        if not usable.all():
            stamp_ns = int(scans.stamps_ns[np.argmin(usable)])
            raise RefusedInput(
                'invalid_embedding', f'embedding at {stamp_ns} ns: expected a finite mean, and a finite U of 0 or more'
            )
        near = valid_positions(scans.positions_m)
        if not near.all():
            row = int(np.argmin(near))
            _refuse_invalid_position(int(scans.stamps_ns[row]), scans.positions_m[row].tolist())

    def _find_matched(self, x_m: float, y_m: float) -> list[int]:
        """Rows of the places within D_t, nearest first; of equal distances the older place first."""
        rows = self._grid.near(x_m, y_m, self.config.match_distance_m)
        if not rows:
            return []
        positions_m = self._match_positions(np.array(rows, np.intp)).tolist()
        apart_m = [math.hypot(east_m - x_m, north_m - y_m) for east_m, north_m in positions_m]
        return [
            row for distance, row in sorted(zip(apart_m, rows, strict=True)) if distance < self.config.match_distance_m
        ]

    def _match_positions(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """(N, 2) positions that D_t is measured to.

        With `pose` it is the position of the scan that a place holds: ever more certain scans of one drive can move the
        place along the road, and leave a stretch of any length without one. With `anchor` it is constant: after a merge
        at a position, the map holds a scan within 2·D_t of it.
        """
        anchored = self.config.match_position == 'anchor'
        return self._anchors_m[rows] if anchored else self.view.positions_m[rows, :2]

    def _less_certain(self, matched: list[int], uncertainty: float) -> list[int]:
        """Rows, of the matched ones (nearest first), that a scan of this U replaces."""
        held = self.view.uncertainties[matched].tolist()
        if self.config.replace == 'all':
            compared = list(range(len(matched)))
        else:
            compared = [0 if self.config.replace == 'nearest' else held.index(max(held))]
        return [matched[i] for i in compared if uncertainty < held[i] - self.config.replace_margin]

    def _insert(self, scan: PlaceTable) -> int:
        """Add a scan, a table of one row, as a new place; returns its id."""
        row, place_id = len(self), self.next_place_id
        self._columns.upsert(dataclasses.replace(scan, place_ids=np.array([place_id], np.int64)))
        self._set_anchors(row, scan.positions_m[:, :2])
        self._grid.add(row, *scan.positions_m[0, :2].tolist())
        self.next_place_id += 1
        return place_id

    def _replace(self, rows: list[int], scan: PlaceTable) -> None:
        """Write a scan, a table of one row, into each of these places."""
        copies = take_rows(scan, np.zeros(len(rows), np.intp))
        self._overwrite(dataclasses.replace(copies, place_ids=self.view.place_ids[rows]))

    def restore(self, places: list[Place]) -> None:
        """Overwrite places of the map with earlier content; their anchors stay."""
        self._overwrite(PlaceTable.from_places(places, self.dimension))

    def _overwrite(self, table: PlaceTable) -> None:
        rows = self._rows(table.place_ids)
        if self.config.match_position == 'pose':
            for row, (x_m, y_m, _) in zip(rows.tolist(), table.positions_m.tolist(), strict=True):
                self._grid.remove(row, *self.view.positions_m[row, :2].tolist())
                self._grid.add(row, x_m, y_m)
        self._columns.upsert(table)

    def remove(self, place_ids: list[int]) -> None:
        """Remove places; ValueError unless they are the newest ones, as in an undo of what was added last."""
        ids = np.array(sorted(place_ids), np.int64)
        first = len(self) - len(ids)
        if not np.array_equal(self._rows(ids), np.arange(first, len(self))):
            raise ValueError(f'places {place_ids} are not the newest {len(ids)} of the map')
        for row, (x_m, y_m) in enumerate(self._match_positions(np.arange(first, len(self))).tolist(), start=first):
            self._grid.remove(row, x_m, y_m)
        self._columns.remove(ids)

    def load(self, places: PlaceColumns, anchors_m: NDArray[np.float64], next_place_id: int) -> None:
        """Fill an empty map with stored places, without a copy; `anchors_m` (N, 2) float64."""
        if len(self):
            raise ValueError('places are loaded into an empty map only')
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
        return float(np.mean(self.view.uncertainties, dtype=np.float64)) if len(self) else math.nan

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
