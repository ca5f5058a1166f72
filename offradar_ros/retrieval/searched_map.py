"""The map that queries search: the places of ended sessions and, apart from them, those of the running session."""

from __future__ import annotations

import collections
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.map_reader import FileState, file_state, read_committed
from offradar_ros.mapping.place_columns import take_rows
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import Candidate, Embedding, PlaceTable

HELD_UPDATES = 64
"""Updates of the running session that may wait for a later scan."""


class SearchedMap:
    """Places of one model, and the nearest of them to an embedding. One thread at a time."""

    def __init__(self) -> None:
        self.model = ''
        """Fingerprint of the model of all places; empty as long as none is known."""
        self._committed, self._running = PlaceIndex(0), PlaceIndex(0)
        self._arrived: collections.deque[PlaceTable] = collections.deque()
        self._file: FileState | None = None

    def __len__(self) -> int:
        """Number of places of ended sessions."""
        return len(self._committed)

    @property
    def dimension(self) -> int:
        """d, the dimension of the means; 0 as long as no model is known."""
        return self._committed.dimension

    def load(self, table: PlaceTable, model: str) -> None:
        """Search these places, of the model with this fingerprint, and no others.

        RefusedInput (`invalid_place`) for a mean that is not finite, and the map stays as it was.
        """
        committed = PlaceIndex(table.means.shape[1], len(table))
        committed.upsert(table)
        self._replace(committed, model)

    def load_file(self, path: Path) -> None:
        """Search the map at `path` as of its last ended session; MapError, and go on as before, if it cannot be read.

        The places go from the file straight into the index, so that the memory of one map is enough. A file that was
        not written since is not read again: that would take the memory of two.
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
        self._arrived.clear()
        self.model = model
        self._file = None

    def update(self, table: PlaceTable, model: str, *, committed: bool) -> None:
        """Take changed places: of ended sessions, or of the running one, which are kept apart.

        The first places of all start the map. RefusedInput (`wrong_model`, `wrong_dimension`, `invalid_place`) leaves
        the map as it was.
        """
        if not self.model:
            self.load(take_rows(table, slice(0)), model)
        elif self.model != model:
            raise RefusedInput(
                'wrong_model', f'{len(table)} places dropped: of model {model[:12]}, the map is of {self.model[:12]}'
            )
        if committed:
            self._committed.upsert(table)
            self._file = None
            self._running.remove(table.place_ids)
            self._arrived.clear()
        else:
            self._running.check(table)
            self._arrived.append(table)

    def nearest(self, embedding: Embedding, k: int, *, with_running: bool = False) -> tuple[Candidate, ...]:
        """The k places nearest to a mean (d,) by Euclidean distance, nearest first; fewer where there are fewer.

        `with_running` searches the running session as well, as it was before this scan: a place that the session
        changed is searched as it is now, unless it now holds this very scan. The embedding's dimension must be the
        map's.
        """
        if not self.model:
            return ()
        self._take_rows_before(embedding.stamp_ns)
        if not with_running or not len(self._running):
            return tuple(self._committed.search(embedding.mean, k))
        own = self._running.place_ids_at(embedding.stamp_ns)
        changed: NDArray[np.int64] = np.setdiff1d(self._running.place_ids, own)
        found = self._committed.search(embedding.mean, k, without=changed)
        found += self._running.search(embedding.mean, k, without=own)
        return tuple(sorted(found, key=lambda candidate: (candidate.distance, candidate.place_id))[:k])

    def _take_rows_before(self, stamp_ns: int) -> None:
        # Whether a scan's own row comes before or after the scan is chance: it counts from the next scan on.
        while self._arrived and (self._arrived[0].stamps_ns.max() < stamp_ns or len(self._arrived) > HELD_UPDATES):
            self._running.upsert(self._arrived.popleft())
