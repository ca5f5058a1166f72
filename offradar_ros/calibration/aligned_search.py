"""Searches one map, and aligns the nearest places with each scan, as the query node does."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.aligned_places import AlignedPlaces
from offradar_ros.retrieval.evidence import EvidenceTable
from offradar_ros.retrieval.rival_alignments import scores_elsewhere
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.signature_source import SignatureSource
from offradar_ros.retrieval.verification import Verifier
from offradar_ros.types import Candidate, Embedding, Evidence, PlaceTable

_MODEL = 'calibrated'


class AlignedSearch:
    """A map of one drive. Not thread-safe.

    Args:
        table: its places, with ids 0, 1, …
        signatures: of the scans that they hold.
        places: k, how many are aligned with each scan.
        tolerance_m: places within this of the first one are the same answer.
    """

    def __init__(self, table: PlaceTable, signatures: SignatureSource, places: int, tolerance_m: float) -> None:
        self._searched, self._verifier = SearchedMap(), Verifier(signatures)
        self._searched.load(table, _MODEL)
        self._positions_m, self._places, self._tolerance_m = table.positions_m[:, :2], places, tolerance_m

    def nearest(
        self, stamp_ns: int, mean: NDArray[np.float32], uncertainty: float, signature: bytes
    ) -> list[tuple[Candidate, Evidence]]:
        """The k nearest places of a scan, aligned with its packed signature, and the evidence for each.

        In a map of fewer, the last one is repeated without an alignment.
        """
        variance = np.full(len(mean), uncertainty, np.float32)
        search = self._searched.around(Embedding(stamp_ns, mean, variance, _MODEL, signature))
        candidates = search.nearest(self._places)
        scans = [search.scan_of(candidate) for candidate in candidates]
        found = self._verifier.align(signature, scans)
        answer = [
            (dataclasses.replace(candidate, alignment=found.get(scan)), search.evidence(candidate, self._tolerance_m))
            for candidate, scan in zip(candidates, scans, strict=True)
        ]
        last, evidence = answer[-1]
        missing = self._places - len(answer)
        return [*answer, *[(dataclasses.replace(last, alignment=None), evidence)] * missing]

    def judged(
        self, answers: Sequence[Sequence[tuple[Candidate, Evidence]]], positions_m: NDArray[np.float64]
    ) -> AlignedPlaces:
        """The answers of `nearest` to Q scans that were taken at (Q, 2) positions."""
        shape = len(answers), self._places
        nearest, scores, elsewhere = np.empty(shape, np.int64), np.full(shape, np.nan), np.empty(shape)
        for number, answer in enumerate(answers):
            candidates = [candidate for candidate, _ in answer]
            nearest[number] = [candidate.place_id for candidate in candidates]
            scores[number] = [each.alignment.score if each.alignment else np.nan for each in candidates]
            elsewhere[number] = scores_elsewhere(candidates)
        evidence = [evidence for answer in answers for _, evidence in answer]
        columns = [
            np.array([getattr(one, field.name) for one in evidence], np.float64)
            for field in dataclasses.fields(Evidence)
        ]
        away_m = np.hypot(*(self._positions_m[nearest] - positions_m[:, None]).transpose(2, 0, 1))
        return AlignedPlaces(EvidenceTable(nearest.ravel(), *columns), scores, elsewhere, away_m <= self._tolerance_m)
