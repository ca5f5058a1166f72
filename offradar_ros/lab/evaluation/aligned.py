"""Answers of which the nearest places were aligned with the query, for fitting and measuring the second opinion."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.scan_odometry import ScanOdometry
from offradar_ros.alignment.signature import Signature, SignatureMaker
from offradar_ros.alignment.signature_code import pack
from offradar_ros.calibration.open_set import halves, joined_evidence
from offradar_ros.config import ConfidenceConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import wrap_angle
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import map_rows, places_of
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.retrieval.confidence import log_odds
from offradar_ros.retrieval.evidence import EvidenceTable
from offradar_ros.retrieval.rival_alignments import scores_elsewhere
from offradar_ros.retrieval.searched_map import SearchedMap
from offradar_ros.retrieval.verification import Verifier
from offradar_ros.types import Candidate, Embedding, Evidence, ScanKey

MODEL = 'evaluated'
SEARCHED = 10
"""Places of which the nearest few are aligned, and all count in Recall@10."""
SCANS_BEFORE = 3
"""Scans from which the velocity at a scan is found: three give two estimates that can agree, or one that is held."""


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


class DriveSignatures:
    """Packed signatures of the drives of one world, made when they are first read. Not thread-safe.

    Their velocities are those of the drive's few scans before, as a vehicle's are of all scans. Scans that cannot be
    read have none.
    """

    def __init__(self, drives: Sequence[Drive]) -> None:
        self._drives, self._make = drives, SignatureMaker()
        self._plain: dict[tuple[int, int], Signature | None] = {}
        self._made: dict[ScanKey, bytes] = {}

    def number_of(self, drive: Drive) -> int:
        """The session of a drive in the keys of its scans."""
        return next(number for number, one in enumerate(self._drives) if one is drive)

    def of(self, drive: Drive, row: int) -> bytes:
        """The signature of scan `row`; empty for none."""
        return self._of(self.number_of(drive), row)

    def read(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """As `SignatureSource.read`."""
        found = {}
        for key in scans:
            (row, *_) = np.flatnonzero(self._drives[key.session_id].stamps_ns == key.stamp_ns).tolist()
            if made := self._of(key.session_id, row):
                found[key] = made
        return found

    def _of(self, number: int, row: int) -> bytes:
        stamps_ns = self._drives[number].stamps_ns
        key = ScanKey(number, int(stamps_ns[row]))
        if key not in self._made:
            own, odometry, twist = self._plain_of(number, row), ScanOdometry(), None
            for before in range(max(row - SCANS_BEFORE, 0), row + 1) if own else ():
                if plain := self._plain_of(number, before):
                    twist = odometry.twist(plain, int(stamps_ns[before]))
            self._made[key] = pack(dataclasses.replace(own, twist=twist)) if own else b''
        return self._made[key]

    def _plain_of(self, number: int, row: int) -> Signature | None:
        if (number, row) not in self._plain:
            self._plain[number, row] = None
            with contextlib.suppress(RefusedInput):
                self._plain[number, row] = self._make(self._drives[number].scan(row))
        return self._plain[number, row]


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
        self._rows, self._signatures = rows, signatures
        self._tolerance_m, self._places = tolerance_m, places
        self._searched, self._verifier = SearchedMap(), Verifier(signatures)
        self._searched.load(self._table, MODEL)

    def answers(self, query: EmbeddedDrive, rows: NDArray[np.intp]) -> AlignedAnswers:
        """The answers to (Q,) scans of a drive."""
        shape = len(rows), self._places
        nearest, scores, elsewhere = np.empty(shape, np.int64), np.full(shape, np.nan), np.zeros(shape)
        poses, covariances = np.full((*shape, 3), np.nan), np.full((*shape, 3, 3), np.nan)
        evidence: list[Evidence] = []
        ten: list[list[int]] = []
        for number, row in enumerate(rows.tolist()):
            candidates, farther, of_each = self._answer(query, row, self._signatures.of(query.drive, row))
            ten.append([candidate.place_id for candidate in (*candidates, *farther)])
            evidence += of_each
            elsewhere[number] = scores_elsewhere(candidates)
            for place, candidate in enumerate(candidates):
                nearest[number, place] = candidate.place_id
                if found := candidate.alignment:
                    scores[number, place] = found.score
                    poses[number, place], covariances[number, place] = found.pose, found.covariance
        truth = query.drive.poses[rows]
        positions_m, yaws_rad = self._table.positions_m[:, :2], self._table.yaws_rad
        truths = _relative(positions_m[nearest], yaws_rad[nearest], truth)
        errors = poses - truths
        errors[..., 2] = wrap_angle(errors[..., 2])
        away_m = np.hypot(*(positions_m[None] - truth[:, None, :2]).transpose(2, 0, 1))
        return AlignedAnswers(
            _table_of(evidence, nearest),
            scores,
            elsewhere,
            errors,
            covariances,
            truths,
            np.take_along_axis(away_m, nearest, axis=1),
            away_m.min(axis=1) <= self._tolerance_m,
            np.take_along_axis(away_m, np.array(ten), axis=1).min(axis=1) <= self._tolerance_m,
            query.drive.kinds[rows],
            rows.astype(np.int64),
            self._rows[nearest].astype(np.int64),
        )

    def _answer(
        self, query: EmbeddedDrive, row: int, signature: bytes
    ) -> tuple[list[Candidate], tuple[Candidate, ...], list[Evidence]]:
        """The places that are aligned, farther ones of the ten nearest, and the evidence for each of the first."""
        mean, uncertainty = query.means[row], query.uncertainties[row]
        variance = np.full(len(mean), uncertainty, np.float32)
        scan = Embedding(int(query.drive.stamps_ns[row]), mean, variance, MODEL, signature)
        search = self._searched.around(scan)
        found_near = search.nearest(max(self._places, SEARCHED))
        candidates, farther = found_near[: self._places], found_near[self._places :]
        scans = [search.scan_of(candidate) for candidate in candidates]
        found = self._verifier.align(signature, scans)
        aligned = [dataclasses.replace(c, alignment=found.get(s)) for c, s in zip(candidates, scans, strict=True)]
        return aligned, farther, [search.evidence(candidate, self._tolerance_m) for candidate in candidates]


def _relative(
    positions_m: NDArray[np.float64], yaws_rad: NDArray[np.float64], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(Q, k, 3) the true poses of queries (Q, 3) in the frames of their places (Q, k, 2) and (Q, k)."""
    x_m, y_m = (truth[:, None, :2] - positions_m).transpose(2, 0, 1)
    cos, sin = np.cos(yaws_rad), np.sin(yaws_rad)
    yaw_rad = wrap_angle(truth[:, None, 2] - yaws_rad)
    return np.stack([cos * x_m + sin * y_m, cos * y_m - sin * x_m, yaw_rad], axis=-1)


def _table_of(evidence: Sequence[Evidence], nearest: NDArray[np.int64]) -> EvidenceTable:
    columns = [
        np.array([getattr(one, field.name) for one in evidence], np.float64) for field in dataclasses.fields(Evidence)
    ]
    return EvidenceTable(nearest.ravel(), *columns)


def joined_answers(several: Sequence[AlignedAnswers]) -> AlignedAnswers:
    """The queries of all, one after another; places remain rows of each one's own map."""
    tables = joined_evidence([one.evidence for one in several])
    rest = [
        np.concatenate([getattr(one, field.name) for one in several])
        for field in dataclasses.fields(AlignedAnswers)[1:]
    ]
    return AlignedAnswers(tables, *rest)


def nearest_odds(
    evidence: EvidenceTable, shape: tuple[int, ...], coefficients: ConfidenceConfig
) -> NDArray[np.float64]:
    """(Q, k) float64 log-odds with the distance of each of k places, and all other evidence of the nearest."""
    columns = [getattr(evidence, field.name).reshape(shape) for field in dataclasses.fields(evidence)[2:]]
    of_nearest = [np.repeat(column[:, :1], shape[1], axis=1).ravel() for column in columns]
    return log_odds(EvidenceTable(evidence.nearest, evidence.distance, *of_nearest), coefficients).reshape(shape)
