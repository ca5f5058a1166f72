"""The third stage: embeddings in, matches and rejections out, and where the vehicle is after all of them."""

from __future__ import annotations

import collections
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from offradar_ros.config import LocalisationConfig, QueryConfig
from offradar_ros.errors import OffradarError, RefusedInput
from offradar_ros.mapping.map_reader import status_of
from offradar_ros.mapping.signature_file import SignatureFile
from offradar_ros.retrieval.confidence import confidence_for
from offradar_ros.retrieval.introspective_query import Answer, IntrospectiveQuery
from offradar_ros.retrieval.received_signatures import ReceivedSignatures
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.signature_source import SignatureSource
from offradar_ros.retrieval.verification import Verifier
from offradar_ros.stages.localise import LocaliseStage, Relocalisation
from offradar_ros.types import Embedding, Localisation, Outcome, PlaceTable, Pose, Reason, Rejection, ScanKey

WINDOW = 256
"""Number of answers in the moving average of U."""


class QueryStage:
    """One map, its updates, and answers from it with thresholds that may change. Not thread-safe.

    Args:
        config: of the answers.
        localisation: of the belief over many scans; the default one if left out.
        signatures: of the scans that the places hold; by default those in the file of `query.map_path`, if set, else
            those that come with `update` and `receive_signatures`.
    """

    def __init__(
        self,
        config: QueryConfig,
        localisation: LocalisationConfig | None = None,
        signatures: SignatureSource | None = None,
    ) -> None:
        self._received = ReceivedSignatures()
        if signatures is None:
            signatures = SignatureFile(Path(config.map_path)) if config.map_path else self._received
        self._is_received = signatures is self._received
        self._query = IntrospectiveQuery(config, SearchedMap(), Verifier(signatures, self._note))
        self._not_aligned = ''
        self._localisation = localisation or LocalisationConfig()
        self._localise = LocaliseStage(self._localisation, config.tolerance_m)
        self._localised_map = 0
        # The map, by its number of changes, that cannot be localised in, and why.
        self._unusable: tuple[int, str] | None = None
        self._last: tuple[int, Answer] | None = None
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
        """Use other thresholds from now on; the map stays. With another tolerance, localisation starts again."""
        if config.tolerance_m != self.config.tolerance_m:
            self._localise = LocaliseStage(self._localisation, config.tolerance_m)
            self._localised_map, self._unusable = 0, None
        self._query = IntrospectiveQuery(config, self._query.map, self._query.verifier)

    def open_file(self) -> bool:
        """Read the file of `query.map_path`, if set; MapError if it cannot be read.

        Returns True if the caller should try again later: the file does not exist yet, but its folder does, so that the
        map server may still write it.
        """
        path = Path(self.config.map_path)
        if not self.config.map_path:
            return False
        if status_of(path) is None and path.parent.is_dir():
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

    def load(self, table: PlaceTable, model: str, checksums: Sequence[int] = ()) -> None:
        """As `SearchedMap.load`; `checksums` of the scans' signatures: one a place, 0 for none, or none at all."""
        self._query.map.load(table, model)
        if self._is_received:
            self._received.expect(dict(zip(table.scans(), checksums or [0] * len(table), strict=True)))

    def update(self, table: PlaceTable, model: str, *, committed: bool, signatures: Sequence[bytes] = ()) -> None:
        """As `SearchedMap.update`; `signatures` are those of the scans that the rows hold, one a row or none."""
        self._query.map.update(table, model, committed=committed)
        if committed or not self._is_received:
            return
        for scan, signature in zip(table.scans(), signatures or [b''] * len(table), strict=True):
            self._received.put(scan, signature)
        if self._received.is_check_due:
            self._received.keep(self._query.map.scans())

    def wanted_signatures(self) -> tuple[ScanKey, ...]:
        """The scans whose signatures the map server is to be asked for now (`ReceivedSignatures.wanted`); none if no
        scan is aligned, or they are read elsewhere.
        """
        return self._received.wanted() if self.missing_signatures else ()

    def receive_signatures(self, answer: Mapping[ScanKey, bytes]) -> list[RefusedInput]:
        """As `ReceivedSignatures.receive`."""
        return self._received.receive(answer)

    @property
    def missing_signatures(self) -> int:
        """Number of scans whose signatures are to be asked for, or have not come yet."""
        return self._received.missing if self._is_received and self.config.verify else 0

    def query(self, embedding: Embedding) -> Outcome:
        """As `IntrospectiveQuery.query`: exactly one answer for each embedding."""
        self._not_aligned = '' if embedding.signature else 'the scan has no signature (encoder.signature)'
        answer = self._query.answer(embedding)
        if not self._not_aligned and not any(each.alignment for each in answer.outcome.candidates):
            self._not_aligned = self._why_no_signatures()
        self._last = embedding.stamp_ns, answer
        if math.isfinite(answer.outcome.uncertainty):
            self._uncertainties.append(answer.outcome.uncertainty)
        return answer.outcome

    @property
    def not_aligned(self) -> str:
        """Why the last scan was aligned with no place, or none can be, in one line; empty if it was, or had none."""
        if not self.config.verify:
            return 'query.verify is false'
        if self._last is None or not self._last[1].outcome.candidates:
            return ''
        return self._not_aligned

    def _why_no_signatures(self) -> str:
        if missing := self.missing_signatures:
            return f'{missing} signatures of the map have not come yet from the map server, on map/signatures'
        return 'the map has no signatures of the places found: it gains them with the next drives'

    def _note(self, problem: OffradarError) -> None:
        self._not_aligned = str(problem)

    @property
    def not_localised(self) -> str:
        """Why `localise` gives nothing, in one line; empty if it does."""
        most = self._localisation.max_places
        if not most:
            return 'localisation.max_places is 0'
        if self.places > most:
            return f'the map has {self.places} places, more than localisation.max_places = {most}'
        if not self.places:
            return 'no map to search'
        if confidence_for(self._query.map.model, self.config.confidence) is None:
            return f'no coefficients of the probability are known for model {self._query.map.model[:12]}'
        if self._unusable and self._unusable[0] == self._query.map.changes:
            return self._unusable[1]
        return ''

    def add_odometry(self, stamp_ns: int, pose: Pose) -> None:
        """Add a position of the vehicle by odometry; RefusedInput unless it is newer than the last one."""
        self._localise.add_odometry(stamp_ns, pose)

    def localise(self) -> Localisation | None:
        """Where the vehicle is after the scan of the last `query`, in the map as of the last ended session.

        None before the first scan, and if it is `not_localised`. RefusedInput (`map_too_dense`) once for a map that
        cannot be localised in, and (`repeated_stamp`, `stamp_backwards`) for a scan that is not newer than the one
        before; it is left out. None instead, if it was rejected as invalid:
        the encoder has refused and counted it.
        """
        if self._last is None or self.not_localised:
            return None
        self._take_map()
        stamp_ns, answer = self._last
        try:
            return self._localise.add_scan(stamp_ns, answer.similar, answer.pose)
        except RefusedInput:
            if isinstance(answer.outcome, Rejection) and answer.outcome.reason is Reason.INVALID_EMBEDDING:
                return None
            raise

    def relocalise(self) -> Relocalisation:
        """As `LocaliseStage.relocalise`."""
        if problem := self.not_localised:
            return Relocalisation(None, problem)
        try:
            self._take_map()
        except RefusedInput as refused:
            return Relocalisation(None, str(refused))
        return self._localise.relocalise()

    def _take_map(self) -> None:
        searched = self._query.map
        if searched.changes != self._localised_map:
            try:
                self._localise.set_places(searched.positions_m, searched.place_ids)
            except RefusedInput as problem:
                self._unusable = searched.changes, str(problem)
                raise
            self._localised_map = searched.changes
