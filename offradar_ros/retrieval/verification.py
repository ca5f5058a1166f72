"""A second opinion on the nearest places: the scan is aligned with theirs, and the places are ordered by both."""

from __future__ import annotations

import collections
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from offradar_ros.alignment.align import (
    PreparedPlace,
    PreparedQuery,
    align_each,
    prepare_place,
    prepare_query,
    require_alike,
)
from offradar_ros.alignment.signature import Signature
from offradar_ros.alignment.signature_code import unpack
from offradar_ros.alignment.twist import STANDING, Twist
from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import OffradarError, RefusedInput
from offradar_ros.retrieval.confidence import log_odds, similar_places, verified
from offradar_ros.retrieval.rival_alignments import scores_elsewhere
from offradar_ros.retrieval.signature_source import SignatureSource
from offradar_ros.types import Alignment, Candidate, Evidence, ScanKey

_T = TypeVar('_T')
PREPARED = 64
"""Places that are kept ready, some 0.4 MB each: those of the next scan are mostly those of this one."""


class _Prepared(Generic[_T]):
    """A scan that is prepared when that is needed, with or without the motion during its sweep."""

    def __init__(self, signature: Signature, prepare: Callable[[Signature, Twist], _T]) -> None:
        self._signature, self._prepare = signature, prepare
        self._ready: dict[Twist, _T] = {}

    @property
    def has_twist(self) -> bool:
        return self._signature.twist is not None

    def ready(self, straighten: bool) -> _T:
        """The scan, straightened if it is asked for and its velocity is known."""
        twist = (straighten and self._signature.twist) or STANDING
        if twist not in self._ready:
            self._ready[twist] = self._prepare(self._signature, twist)
        return self._ready[twist]


class Verifier:
    """Aligns scans with those that places hold. Not thread-safe.

    Args:
        source: where the signatures of the map are read; None for nowhere.
        refuse: called with what is wrong with a signature or their source, which is then as if it were not there.
    """

    def __init__(
        self, source: SignatureSource | None = None, refuse: Callable[[OffradarError], None] = lambda _: None
    ) -> None:
        self._source, self._refuse = source, refuse
        # By content: a scan of the same key in another map has another one.
        self._places: collections.OrderedDict[bytes, _Prepared[PreparedPlace]] = collections.OrderedDict()

    def align(self, signature: bytes, scans: Sequence[ScanKey]) -> dict[ScanKey, Alignment]:
        """The alignments of a scan, by its signature, with these; those without a sound signature are left out."""
        unpacked = self._unpacked(signature) if signature and self._source is not None else None
        if unpacked is None or self._source is None:
            return {}
        try:
            contents = self._source.read(scans)
        except OffradarError as problem:
            self._refuse(problem)
            return {}
        query = _Prepared(unpacked, prepare_query)
        places: dict[bool, dict[ScanKey, PreparedPlace]] = {False: {}, True: {}}
        for scan, content in contents.items():
            if (place := self._place(content)) is None:
                continue
            # Two scans that are bent alike agree better than if only one of them is straightened.
            straighten = query.has_twist and place.has_twist
            places[straighten][scan] = place.ready(straighten)
        found: dict[ScanKey, Alignment] = {}
        for straighten, ready in places.items():
            if ready:
                found |= self._aligned(ready, query.ready(straighten))
        return {scan: found[scan] for scan in contents if scan in found}

    def _aligned(self, places: dict[ScanKey, PreparedPlace], query: PreparedQuery) -> dict[ScanKey, Alignment]:
        alike = {}
        for scan, place in places.items():
            try:
                require_alike(place, query)
            except RefusedInput as problem:
                self._refuse(problem)
            else:
                alike[scan] = place
        return dict(zip(alike, align_each(list(alike.values()), query), strict=True))

    def _place(self, content: bytes) -> _Prepared[PreparedPlace] | None:
        if content in self._places:
            self._places.move_to_end(content)
            return self._places[content]
        unpacked = self._unpacked(content)
        if unpacked is None:
            return None
        self._places[content] = _Prepared(unpacked, prepare_place)
        while len(self._places) > PREPARED:
            self._places.popitem(last=False)
        return self._places[content]

    def _unpacked(self, content: bytes) -> Signature | None:
        try:
            return unpack(content)
        except RefusedInput as problem:
            self._refuse(problem)
            return None


def ranked(
    candidates: Sequence[Candidate], evidence: Evidence, coefficients: ConfidenceConfig
) -> tuple[Candidate, ...]:
    """Candidates in the order of the log-odds that both opinions give, the likeliest first.

    Only those that are aligned change places, among one another. The log-odds of each are those with its distance, and
    all other evidence of the first one.
    """
    rows = [row for row, candidate in enumerate(candidates) if candidate.alignment is not None]
    if not coefficients.score or len(rows) < 2:
        return tuple(candidates)
    aligned = [candidates[row] for row in rows]
    distances = np.array([candidate.distance for candidate in aligned], np.float32)
    odds = similar_places(np.array(rows, np.int64), distances, evidence, coefficients).log_odds
    scores = np.array([candidate.alignment.score for candidate in aligned if candidate.alignment is not None])
    order = np.argsort(-verified(odds, scores, scores_elsewhere(aligned), coefficients), kind='stable')
    result = list(candidates)
    for row, better in zip(rows, order.tolist(), strict=True):
        result[row] = aligned[better]
    return tuple(result)


def verified_log_odds(evidence: Evidence, candidates: Sequence[Candidate], coefficients: ConfidenceConfig) -> float:
    """Log-odds that the first place is right, from its evidence and, where it is aligned, the scores of all."""
    alignment = candidates[0].alignment
    if alignment is None:
        return float(log_odds(evidence, coefficients))
    elsewhere = float(scores_elsewhere(candidates)[0])
    return float(verified(log_odds(evidence, coefficients), alignment.score, elsewhere, coefficients))
