"""The third stage: embeddings in, matches and rejections out."""

from __future__ import annotations

import collections
import math
from pathlib import Path

import numpy as np

from offradar_ros.config import QueryConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.retrieval.introspective_query import IntrospectiveQuery
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.types import Embedding, Outcome, PlaceTable

WINDOW = 256
"""Number of answers in the moving average of U."""


class QueryStage:
    """One map, its updates, and answers from it with thresholds that may change. Not thread-safe."""

    def __init__(self, config: QueryConfig) -> None:
        self._query = IntrospectiveQuery(config, SearchedMap())
        self._uncertainties: collections.deque[float] = collections.deque(maxlen=WINDOW)

    @property
    def config(self) -> QueryConfig:
        """The present configuration."""
        return self._query.config

    @property
    def threshold(self) -> float:
        """U above which a scan is rejected."""
        return self._query.threshold

    @property
    def places(self) -> int:
        """Number of places of ended sessions."""
        return len(self._query.map)

    @property
    def mean_uncertainty(self) -> float:
        """Mean U of the last `WINDOW` valid embeddings; NaN if there was none."""
        return float(np.mean(self._uncertainties)) if self._uncertainties else math.nan

    @property
    def warning(self) -> str:
        """Why answers may not be useful, in one line; empty if no reason is known."""
        if not self.places:
            return 'no map to search'
        if abs(self.mean_uncertainty - 1.0) > self.config.delta:
            return f'mean U {self.mean_uncertainty:.2f} is not near 1: calibrate for this sensor'
        return ''

    def reconfigure(self, config: QueryConfig) -> None:
        """Use other thresholds from now on; the map stays."""
        self._query = IntrospectiveQuery(config, self._query.map)

    def open_file(self) -> bool:
        """Read the file of `query.map_path`, if set; MapError if it cannot be read.

        Returns True if the caller should try again later: the file does not exist yet, but its folder does, so that the
        map server may still write it.
        """
        path = Path(self.config.map_path)
        if not self.config.map_path:
            return False
        if not path.exists() and path.parent.is_dir():
            return True
        self.read_file()
        return False

    def read_file(self) -> None:
        """Replace the map by the file of `query.map_path` as of its last ended session (see `SearchedMap.load_file`).

        For a map that is too large for a message. RefusedInput (`map_too_large`) if no file is set, MapError if it
        cannot be read; the map is then unchanged.
        """
        if not self.config.map_path:
            raise RefusedInput(
                'map_too_large',
                'the map is too large for a message: set query.map_path to the file of the map server',
            )
        self._query.map.load_file(Path(self.config.map_path))

    def load(self, table: PlaceTable, model: str) -> None:
        """As `SearchedMap.load`."""
        self._query.map.load(table, model)

    def update(self, table: PlaceTable, model: str, *, committed: bool) -> None:
        """As `SearchedMap.update`."""
        self._query.map.update(table, model, committed=committed)

    def query(self, embedding: Embedding) -> Outcome:
        """As `IntrospectiveQuery.query`: exactly one answer for each embedding."""
        outcome = self._query.query(embedding)
        if math.isfinite(outcome.uncertainty):
            self._uncertainties.append(outcome.uncertainty)
        return outcome
