"""The map that queries search: places of ended sessions and, in an index apart, those of the running session."""

from __future__ import annotations

import collections
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.map_reader import FileState, file_state, read_committed
from offradar_ros.mapping.place_columns import take_rows
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import Candidate, Embedding, Evidence, PlaceTable, ScanKey

MAX_WAITING_UPDATES = 64
"""Most updates of the running session that wait for a later scan."""

FoundT = TypeVar('FoundT')

_NO_IDS: NDArray[np.int64] = np.empty(0, np.int64)


class SearchedMap:
    """Places of one model, and a search for those nearest to an embedding. Not thread-safe."""

    def __init__(self) -> None:
        self.model = ''
        """Fingerprint of the model of all places; empty while none is known."""
        self.changes = 0
        """How often the places of ended sessions have changed."""
        self._committed, self._running = PlaceIndex(0), PlaceIndex(0)
        self._waiting_updates: collections.deque[PlaceTable] = collections.deque()
        self._file: FileState | None = None

    def __len__(self) -> int:
        """Number of places of ended sessions."""
        return len(self._committed)

    @property
    def dimension(self) -> int:
        """d, the dimension of the means; 0 while no model is known."""
        return self._committed.dimension

    @property
    def place_ids(self) -> NDArray[np.int64]:
        """(N,) int64 of the places of ended sessions, ascending; a view, valid until the next change."""
        return self._committed.place_ids

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """(N, 3) float64 in the ``map`` frame, in the order of `place_ids`; a view, valid until the next change."""
        return self._committed.positions_m

    def scans(self) -> list[ScanKey]:
        """The scans that places hold, of ended sessions and of the running one."""
        waiting = [scan for table in self._waiting_updates for scan in table.scans()]
        return [*self._committed.scans(), *self._running.scans(), *waiting]

    def load(self, table: PlaceTable, model: str) -> None:
        """Replace the map by these places, of the model with this fingerprint.

        RefusedInput (`invalid_place`) for a place that is not valid (`place_problem`); the map is then unchanged.
        """
        committed = PlaceIndex(table.means.shape[1], len(table))
        committed.upsert(table)
        self._replace(committed, model)

    def load_file(self, path: Path) -> None:
        """Replace the map by the file at `path` as of its last ended session.

        MapError if the file cannot be read; the map is then unchanged. Places are read directly into the index, so that
        memory holds one map. A file that did not change since the last call is not read again, which would need two.
        """
        state = file_state(path)
        if state == self._file:
            self._replace(self._committed, self.model)
        else:
            model, committed = read_committed(path, PlaceIndex)
            self._replace(committed, model)
        self._file = state

    def _replace(self, committed: PlaceIndex, model: str) -> None:
        self._committed, self._running = committed, PlaceIndex(committed.dimension)
        self._waiting_updates.clear()
        self.model = model
        self.changes += 1
        self._file = None

    def update(self, table: PlaceTable, model: str, *, committed: bool) -> None:
        """Add or replace places: `committed` ones of ended sessions, others of the running session.

        The first places of an empty map set its model. RefusedInput (`wrong_model`, `wrong_dimension`,
        `invalid_place`) leaves the map unchanged.
        """
        if not self.model:
            self.load(take_rows(table, slice(0)), model)
        elif self.model != model:
            raise RefusedInput(
                'wrong_model', f'{len(table)} places dropped: of model {model[:12]}, the map is of {self.model[:12]}'
            )
        if committed:
            self._committed.upsert(table)
            self.changes += 1
            self._file = None
            self._running.remove(table.place_ids)
            self._waiting_updates.clear()
        elif len(table):
            self._running.check(table)
            self._waiting_updates.append(table)
            # No query may ever come.
            while len(self._waiting_updates) > MAX_WAITING_UPDATES:
                self._running.upsert(self._waiting_updates.popleft())

    def nearest(self, embedding: Embedding, k: int, *, include_running: bool = False) -> tuple[Candidate, ...]:
        """The k places nearest to a mean (d,) by Euclidean distance, nearest first; fewer if the map has fewer.

        `include_running` searches the running session too, without this scan itself: a place that the session changed
        counts with its present content, unless that is this scan. The embedding must have the map's dimension.
        """
        return self.around(embedding, include_running=include_running).nearest(k)

    def around(self, embedding: Embedding, *, include_running: bool = False) -> MapSearch:
        """The places by their distance to a mean (d,), as `nearest` searches them; valid until the map changes."""
        if not self.model:
            return MapSearch(embedding, [])
        self._apply_updates_before(embedding.stamp_ns)
        if not include_running or not len(self._running):
            return MapSearch(embedding, [(self._committed, _NO_IDS)])
        own = self._running.place_ids_at(embedding.stamp_ns)
        changed: NDArray[np.int64] = np.setdiff1d(self._running.place_ids, own)
        return MapSearch(embedding, [(self._committed, changed), (self._running, own)])

    def _apply_updates_before(self, stamp_ns: int) -> None:
        # The update with a scan's own row may arrive before or after its query: it is applied from the next scan on.
        while self._waiting_updates and self._waiting_updates[0].stamps_ns.max() < stamp_ns:
            self._running.upsert(self._waiting_updates.popleft())


class MapSearch:
    """One query of a map: places of one or two indices, without some ids of each."""

    def __init__(self, embedding: Embedding, indices: Sequence[tuple[PlaceIndex, NDArray[np.int64]]]) -> None:
        self._embedding, self._indices = embedding, indices
        self._searches = [index.around(embedding.mean, excluded) for index, excluded in indices]

    def nearest(self, k: int) -> tuple[Candidate, ...]:
        """The k nearest places, nearest first; of equal distances the lower id first."""
        found = [candidate for search in self._searches for candidate in search.nearest(k)]
        return tuple(sorted(found, key=lambda candidate: (candidate.distance, candidate.place_id))[:k])

    def evidence(self, nearest: Candidate, tolerance_m: float) -> Evidence:
        """The evidence for `nearest`, the first place; places within `tolerance_m` of it are the same answer."""
        here = _ground(nearest)
        mean = self._of(nearest, PlaceIndex.mean_of)
        of_place = [index.around(mean, excluded) for index, excluded in self._indices]
        return Evidence(
            distance=nearest.distance,
            distance_apart=min(search.distance_apart(here, tolerance_m) for search in self._searches),
            place_distance_apart=min(search.distance_apart(here, tolerance_m) for search in of_place),
            uncertainty=self._embedding.uncertainty,
            place_uncertainty=nearest.uncertainty,
        )

    def scan_of(self, candidate: Candidate) -> ScanKey:
        """The scan that a place which was found holds."""
        return self._of(candidate, PlaceIndex.scan_of)

    def _of(self, candidate: Candidate, get: Callable[[PlaceIndex, int], FoundT | None]) -> FoundT:
        """What the index in which a place was found has of it."""
        place_id = candidate.place_id
        every = (get(index, place_id) for index, excluded in self._indices if place_id not in excluded)
        return next(found for found in every if found is not None)

    def near(self, nearest: Candidate, tolerance_m: float) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """(M,) ids of the places within `tolerance_m` of the first place, itself among them, and their distances."""
        found = [search.within(_ground(nearest), tolerance_m) for search in self._searches]
        return np.concatenate([ids for ids, _ in found]), np.concatenate([distances for _, distances in found])


def _ground(place: Candidate) -> NDArray[np.float64]:
    return np.array([place.pose.x_m, place.pose.y_m])
