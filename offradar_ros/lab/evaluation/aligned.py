"""Answers of which the nearest places were aligned with the query, for fitting and measuring the second opinion."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.aligned_places import AlignedPlaces
from offradar_ros.calibration.aligned_search import AlignedSearch
from offradar_ros.calibration.drive_signatures import DriveSignatures
from offradar_ros.calibration.open_set import halves, joined_evidence
from offradar_ros.geometry import wrap_angle
from offradar_ros.lab.evaluation.answers import map_rows, places_of
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.retrieval.evidence import EvidenceTable
from offradar_ros.retrieval.place_index import PlaceIndex

SEARCHED = 10
"""Places of which the nearest few are aligned, and all count in Recall@10."""


@dataclasses.dataclass(frozen=True, eq=False)
class AlignedAnswers:
    """Q queries, each with its k nearest places, which are aligned with it.

    Attributes:
        evidence: Q · k rows, query by query and nearest first: the evidence for each place, as if it were the answer.
        scores: (Q, k) float64 of the alignments, NaN for none.
        elsewhere: (Q, k) float64, those of `scores_elsewhere`.
        errors: (Q, k, 3) float64 of their poses: forward and left in metres, yaw in radians; NaN for none.
        covariances: (Q, k, 3, 3) float64 of their poses.
        truths: (Q, k, 3) float64, the true pose of the query in the frame of each place, as `errors`; NaN where a
            heading is unknown.
        away_m: (Q, k) float64, from the query to each place on the ground.
        on_map: (Q,) whether any place is within the tolerance of the query.
        in_ten: (Q,) whether any of the ten nearest places is, by distance in embedding space; more if k is more.
        kinds: (Q,) text, how the scan is degraded; empty for a clean one.
        query_rows: (Q,) int64, rows of the scans in their drive.
        place_rows: (Q, k) int64, rows of the scans of the places in theirs.
    """

    evidence: EvidenceTable
    scores: NDArray[np.float64]
    elsewhere: NDArray[np.float64]
    errors: NDArray[np.float64]
    covariances: NDArray[np.float64]
    truths: NDArray[np.float64]
    away_m: NDArray[np.float64]
    on_map: NDArray[np.bool_]
    in_ten: NDArray[np.bool_]
    kinds: NDArray[np.str_]
    query_rows: NDArray[np.int64]
    place_rows: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.on_map)

    def judged(self, tolerance_m: float) -> AlignedPlaces:
        """The places, and whether each is within the tolerance of the query."""
        return AlignedPlaces(self.evidence, self.scores, self.elsewhere, self.away_m <= tolerance_m)


def aligned_answers(
    drives: Sequence[EmbeddedDrive],
    spacing_m: float,
    tolerance_m: float,
    *,
    places: int,
    queries: int,
    seed: int,
    whole: bool = False,
) -> Iterator[AlignedAnswers]:
    """The answers of every ordered pair of drives of one world, with either half of the mapped road left out.

    Args:
        drives: of one world, which `open_sets` takes, too.
        spacing_m: path length between two places.
        tolerance_m: an answer within this of the query is right.
        places: k; a map of fewer is left out.
        queries: most scans of each drive that are searched in each map, drawn with `seed`; 0 for all.
        seed: of that.
        whole: the map holds the whole road instead.
    """
    rng, signatures = np.random.default_rng(seed), DriveSignatures([drive.drive for drive in drives])
    for mapped, query in itertools.permutations(drives, 2):
        rows = map_rows(mapped, spacing_m)
        for part in (rows,) if whole else halves(mapped.drive.driven_m, rows):
            asked = drawn_rows(query, queries, rng)
            if len(part) < places or not len(asked):
                continue
            yield AlignedMap(mapped, part, signatures, tolerance_m, places).answers(query, asked)


def drawn_rows(query: EmbeddedDrive, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows of `count` usable scans of a drive, drawn at random, in their order; of all if they are fewer, or for 0."""
    usable = np.flatnonzero(query.usable)
    if 0 < count < len(usable):
        usable = np.sort(rng.choice(usable, count, replace=False))
    return usable


def answers_of_worlds(
    worlds: Iterable[Sequence[EmbeddedDrive]],
    protocol: Protocol,
    spacings_m: Sequence[float],
    *,
    places: int,
    queries: int,
    whole: bool = False,
) -> list[AlignedAnswers]:
    """`aligned_answers` of the drives of each world, for maps of each spacing, drawn with the seed of the protocol."""
    found: list[AlignedAnswers] = []
    for drives, spacing_m in itertools.product(worlds, spacings_m):
        found += aligned_answers(
            drives, spacing_m, protocol.tolerance_m, places=places, queries=queries, seed=protocol.seed, whole=whole
        )
    return found


class AlignedMap:
    """A map whose nearest places are aligned with queries.

    Args:
        mapped: the drive that is mapped.
        rows: (P,) of its scans that the map holds, at least `places`.
        signatures: of the mapped drive and of those that are searched for.
        tolerance_m: an answer within this of the query is right.
        places: k.
    """

    def __init__(
        self,
        mapped: EmbeddedDrive,
        rows: NDArray[np.intp],
        signatures: DriveSignatures,
        tolerance_m: float,
        places: int,
    ) -> None:
        session = np.full(len(rows), signatures.number_of(mapped.drive), np.int32)
        self._table = dataclasses.replace(places_of(mapped, rows), session_ids=session)
        self._rows, self._signatures, self._tolerance_m = rows, signatures, tolerance_m
        self._search = AlignedSearch(self._table, signatures, places, tolerance_m)
        self._index = PlaceIndex(self._table.means.shape[1], len(self._table))
        self._index.upsert(self._table)

    def answers(self, query: EmbeddedDrive, rows: NDArray[np.intp]) -> AlignedAnswers:
        """The answers to (Q,) scans of a drive."""
        drive = query.drive
        found = [
            self._search.nearest(
                int(drive.stamps_ns[row]),
                query.means[row],
                float(query.uncertainties[row]),
                self._signatures.of(drive, row),
            )
            for row in rows.tolist()
        ]
        truth = drive.poses[rows]
        judged = self._search.judged(found, truth[:, :2])
        shape = judged.scores.shape
        poses, covariances = np.full((*shape, 3), np.nan), np.full((*shape, 3, 3), np.nan)
        for place in itertools.product(*map(range, shape)):
            if alignment := found[place[0]][place[1]][0].alignment:
                poses[place], covariances[place] = alignment.pose, alignment.covariance
        nearest = judged.evidence.nearest.reshape(shape)
        positions_m, yaws_rad = self._table.positions_m[:, :2], self._table.yaws_rad
        truths = _relative(positions_m[nearest], yaws_rad[nearest], truth)
        errors = poses - truths
        errors[..., 2] = wrap_angle(errors[..., 2])
        away_m = np.hypot(*(positions_m[None] - truth[:, None, :2]).transpose(2, 0, 1))
        ten, _ = self._index.search_many(query.means[rows], min(max(shape[1], SEARCHED), len(self._table)))
        return AlignedAnswers(
            judged.evidence,
            judged.scores,
            judged.elsewhere,
            errors,
            covariances,
            truths,
            np.take_along_axis(away_m, nearest, axis=1),
            away_m.min(axis=1) <= self._tolerance_m,
            np.take_along_axis(away_m, ten, axis=1).min(axis=1) <= self._tolerance_m,
            drive.kinds[rows],
            rows.astype(np.int64),
            self._rows[nearest].astype(np.int64),
        )


def _relative(
    positions_m: NDArray[np.float64], yaws_rad: NDArray[np.float64], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(Q, k, 3) the true poses of queries (Q, 3) in the frames of their places (Q, k, 2) and (Q, k)."""
    x_m, y_m = (truth[:, None, :2] - positions_m).transpose(2, 0, 1)
    cos, sin = np.cos(yaws_rad), np.sin(yaws_rad)
    yaw_rad = wrap_angle(truth[:, None, 2] - yaws_rad)
    return np.stack([cos * x_m + sin * y_m, cos * y_m - sin * x_m, yaw_rad], axis=-1)


def joined_answers(several: Sequence[AlignedAnswers]) -> AlignedAnswers:
    """The queries of all, one after another; places remain rows of each one's own map."""
    tables = joined_evidence([one.evidence for one in several])
    rest = [
        np.concatenate([getattr(one, field.name) for one in several])
        for field in dataclasses.fields(AlignedAnswers)[1:]
    ]
    return AlignedAnswers(tables, *rest)
