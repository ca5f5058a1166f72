"""Introspective querying (Sec. III-C of the paper): the nearest places, or the reason why not."""

from __future__ import annotations

import collections
import math
from pathlib import Path

import numpy as np

from offradar_ros.config import QueryConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.embedding_check import embedding_problem
from offradar_ros.mapping.map_reader import FileState, file_state, read_committed
from offradar_ros.mapping.place_columns import take_rows
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.retrieval.thresholds import threshold_at
from offradar_ros.types import Candidate, Embedding, Match, Outcome, PlaceTable, Reason, Rejection

HELD_UPDATES = 64
"""Rows of the running session that may wait for a later scan."""


class IntrospectiveQuery:
    """Answers every embedding, with a match or with a reasoned rejection. One thread at a time."""

    def __init__(self, config: QueryConfig) -> None:
        self.reconfigure(config)
        self._model = ''
        self._committed, self._running = self._index(0), self._index(0)
        self._arrived: collections.deque[PlaceTable] = collections.deque()
        self._file: FileState | None = None

    def reconfigure(self, config: QueryConfig) -> None:
        """Go on with other thresholds; the map stays."""
        self.config = config
        self.threshold = threshold_at(config)

    @property
    def places(self) -> int:
        """Number of places of ended sessions."""
        return len(self._committed)

    def load(self, table: PlaceTable, model_fingerprint: str) -> None:
        """Search these places, of this model, and no others."""
        committed = self._index(table.means.shape[1], len(table))
        committed.upsert(table)
        self._search_in(committed, model_fingerprint)

    def load_file(self, path: Path) -> None:
        """Search the map at `path` as of its last ended session; MapError, and go on as before, if it cannot be read.

        The places go from the file straight into the index, so that the memory of one map is enough. A file that was
        not written since is not read again: that would take the memory of two.
        """
        state = file_state(path)
        if state == self._file:
            self._search_in(self._committed, self._model)
        else:
            model_fingerprint, committed = read_committed(path, self._index)
            self._search_in(committed, model_fingerprint)
        self._file = state

    def _index(self, dimension: int, places: int = 16) -> PlaceIndex:
        return PlaceIndex(dimension, places, self.config.storage)

    def _search_in(self, committed: PlaceIndex, model_fingerprint: str) -> None:
        self._committed, self._running = committed, self._index(committed.dimension)
        self._arrived.clear()
        self._model = model_fingerprint
        self._file = None

    def update(self, table: PlaceTable, model_fingerprint: str, committed: bool) -> None:
        """Take changed places: of ended sessions, or of the running one, which are kept apart.

        The first places of all start the map. RefusedInput (`wrong_model`, `wrong_dimension`, `invalid_place`) leaves
        the map as it was.
        """
        if not self._model:
            self.load(take_rows(table, slice(0)), model_fingerprint)
        elif self._model != model_fingerprint:
            raise RefusedInput(
                'wrong_model',
                f'{len(table)} places dropped: of model {model_fingerprint[:12]}, the map is of {self._model[:12]}',
            )
        if committed:
            self._committed.upsert(table)
            self._file = None
            self._running.remove(table.place_ids)
            self._arrived.clear()
        else:
            self._running.check(table)
            self._arrived.append(table)

    def query(self, embedding: Embedding) -> Outcome:
        """The `top_k` nearest places, or a rejection with those that would have been returned where there are any.

        An embedding of another model is rejected as `wrong_model`: of another than the thresholds were calibrated with,
        where `query.model` says so, because they mean nothing for its U; or of another than the map's, where it has
        one. An empty map has one when it is read from a file, and none when it comes as a message: then any model may
        still fill it, and every other valid embedding is rejected as `map_empty`.
        """
        problem = embedding_problem(embedding)
        if problem:
            return self._rejection(embedding, Reason.INVALID_EMBEDDING, (), problem, math.nan)
        problem = self._model_problem(embedding)
        if problem:
            return self._rejection(embedding, Reason.WRONG_MODEL, (), problem)
        candidates = self._nearest(embedding)
        if not candidates:
            return self._rejection(embedding, Reason.MAP_EMPTY, (), 'the map holds no places to search')
        if embedding.uncertainty > self.threshold:
            detail = f'U {embedding.uncertainty:.4g} is above the threshold {self.threshold:.4g}'
            return self._rejection(embedding, Reason.UNCERTAIN, candidates, detail)
        if 0.0 < self.config.max_distance < candidates[0].distance:
            detail = f'the nearest place is {candidates[0].distance:.4g} away, above {self.config.max_distance:.4g}'
            return self._rejection(embedding, Reason.UNKNOWN_PLACE, candidates, detail)
        return Match(embedding.stamp_ns, embedding.uncertainty, self.threshold, candidates)

    def _model_problem(self, embedding: Embedding) -> str | None:
        if self.config.model and embedding.model != self.config.model:
            return (
                f'made by model {embedding.model[:12] or "(none)"}, the thresholds are calibrated for model '
                f'{self.config.model[:12]} (query.model)'
            )
        if not self._model:
            return None
        if embedding.model != self._model:
            return f'made by model {embedding.model[:12] or "(none)"}, the map is of model {self._model[:12]}'
        if embedding.mean.size != self._committed.dimension:
            return f'has dimension {embedding.mean.size}, the map has {self._committed.dimension}'
        return None

    def _nearest(self, embedding: Embedding) -> tuple[Candidate, ...]:
        if not self._model:
            return ()
        k = self.config.top_k
        self._take_rows_before(embedding.stamp_ns)
        if self.config.exclude_current_session or not len(self._running):
            return tuple(self._committed.search(embedding.mean, k))
        # A place that the running session changed is searched as it is now, unless it now holds this very scan.
        own = self._running.place_ids_at(embedding.stamp_ns)
        found = self._committed.search(embedding.mean, k, without=np.setdiff1d(self._running.place_ids, own))
        found += self._running.search(embedding.mean, k, without=own)
        return tuple(sorted(found, key=lambda candidate: (candidate.distance, candidate.place_id))[:k])

    def _take_rows_before(self, stamp_ns: int) -> None:
        # Whether a scan's own row comes before or after the scan is chance: it counts from the next scan on.
        while self._arrived and (self._arrived[0].stamps_ns.max() < stamp_ns or len(self._arrived) > HELD_UPDATES):
            self._running.upsert(self._arrived.popleft())

    def _rejection(
        self,
        embedding: Embedding,
        reason: Reason,
        candidates: tuple[Candidate, ...],
        detail: str,
        uncertainty: float | None = None,
    ) -> Rejection:
        known = embedding.uncertainty if uncertainty is None else uncertainty
        return Rejection(embedding.stamp_ns, reason, known, self.threshold, candidates, detail)
