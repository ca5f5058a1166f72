"""Every scan of one drive searched for in the map of another, and whether its answer is correct."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.open_set import joined_evidence
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.distances import distances_m
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.left_out import WHOLE, rows_in_map
from offradar_ros.lab.evaluation.metrics.pair_level import PairDistances, PairLevel
from offradar_ros.lab.evaluation.spatial_uncertainty import spatial_variance
from offradar_ros.recordings.spacing import subsample_by_distance
from offradar_ros.retrieval.evidence import EvidenceTable, evidence_table
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import PlaceTable

DEPTH = 10
"""Number of nearest places of each query that are evaluated."""

NOT_FOUND = 1_000_000
"""Rank of a query with no positive among them."""

_BLOCK = 256


@dataclasses.dataclass(frozen=True)
class Pair:
    """An ordered pair of drives: `map_index` is mapped and `query_index` searched for, both drives of `world`.

    `map_number` is that of `left_out.maps_of`: 0 if nothing of the map is left out.
    """

    method: str
    group: str
    world: str
    map_index: int
    query_index: int
    spacing_m: float
    map_number: int = WHOLE


class Rules(NamedTuple):
    """Which places count, as in the protocol.

    Attributes:
        tolerance_m: a place within this is a positive.
        negative_m: a place farther than this is a negative.
        exclusion_ns: places whose scans are this near to the query in time are left out; 0 keeps all.
    """

    tolerance_m: float = 25.0
    negative_m: float = 50.0
    exclusion_ns: int = 0


class Signals(NamedTuple):
    """What confidences in answers are computed from: a row for each query that has an answer, in their order.

    Attributes:
        evidence: as of the query node.
        second: (A,) float64 distance of the second nearest place, infinite if there is none.
        spatial_variance_m2: (A,) float64 from `spatial_variance` of the nearest places.
    """

    evidence: EvidenceTable
    second: NDArray[np.float64]
    spatial_variance_m2: NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class Answers:
    """One row for each of Q query scans.

    Attributes:
        pair: the drives.
        places: size of the map.
        uncertainties: (Q,) float64 U, infinite where the encoder refused the scan.
        ranks: (Q,) int64 rank of the first positive by distance in embedding space, 0 for the nearest place;
            `NOT_FOUND` if none of the nearest `DEPTH` places is one.
        positive: (Q,) whether the map holds a positive.
        errors_m: (Q,) metres from where the scan was taken to the place found, the nearest one in embedding space.
        distances: (Q,) distance of the place found, in embedding space.
        found: (Q,) int64 row of the place found in the map.
        nearest: (Q,) int64 row of the place that is nearest to where the scan was taken.
        kinds: (Q,) kind of degradation; empty for a clean scan, and where it is unknown.
        severities: (Q,) severity of the degradation, 0 to 1; NaN where it is unknown.
        pair_level: figures of every query with every place; None if not computed.
        signals: of the `answerable` queries; None if not computed.
    """

    pair: Pair
    places: int
    uncertainties: NDArray[np.float64]
    ranks: NDArray[np.int64]
    positive: NDArray[np.bool_]
    errors_m: NDArray[np.float64]
    distances: NDArray[np.float64]
    found: NDArray[np.int64]
    nearest: NDArray[np.int64]
    kinds: NDArray[np.str_]
    severities: NDArray[np.float64]
    pair_level: PairLevel | None
    signals: Signals | None

    @property
    def correct(self) -> NDArray[np.bool_]:
        """(Q,) whether the place found is a positive."""
        correct: NDArray[np.bool_] = self.ranks == 0
        return correct

    @property
    def answerable(self) -> NDArray[np.bool_]:
        """(Q,) whether there is an answer: the scan has a descriptor, and the map a place that counts."""
        return np.isfinite(self.distances)


def pair_numbers(several: Sequence[Answers]) -> NDArray[np.intp]:
    """(R,) a number for each query of all answers, equal for those of one ordered pair of drives."""
    pairs = [dataclasses.replace(answers.pair, map_number=WHOLE) for answers in several]
    numbers = {pair: number for number, pair in enumerate(dict.fromkeys(pairs))}
    return np.repeat([numbers[pair] for pair in pairs], [len(answers.ranks) for answers in several])


def map_rows(drive: EmbeddedDrive, spacing_m: float) -> NDArray[np.intp]:
    """(P,) rows of the scans that a map with a place every `spacing_m` holds; refused scans are skipped."""
    usable = np.flatnonzero(drive.usable)
    return usable[subsample_by_distance(drive.drive.driven_m[usable], spacing_m)]


def places_of(drive: EmbeddedDrive, rows: NDArray[np.intp]) -> PlaceTable:
    """The places of the map that is made of these scans, in their order."""
    count = len(rows)
    return PlaceTable(
        np.arange(count, dtype=np.int64),
        np.ones(count, np.int32),
        drive.drive.stamps_ns[rows],
        np.column_stack([drive.drive.poses[rows, :2], np.zeros(count)]),
        drive.drive.poses[rows, 2],
        np.full(count, np.nan, np.float32),
        drive.uncertainties[rows].astype(np.float32),
        drive.means[rows],
    )


def search_places(
    pair: Pair,
    places: PlaceTable,
    query: EmbeddedDrive,
    rules: Rules,
    *,
    all_pairs: bool = False,
    with_signals: bool = False,
    depth: int = DEPTH,
) -> Answers:
    """Search the places (ids 0, 1, …) for every scan of `query`, and evaluate the `depth` nearest of each.

    `all_pairs` also computes `pair_level`, and `with_signals` `signals`; each doubles the time.
    """
    count, depth = len(query.means), min(depth, len(places))
    index = PlaceIndex(places.means.shape[1], len(places))
    index.upsert(places)
    ranks = np.full(count, NOT_FOUND, np.int64)
    found, nearest = np.zeros((2, count), np.int64)
    errors_m, distances = np.full((2, count), np.inf)
    positive = np.zeros(count, np.bool_)
    pairs, signals = PairDistances() if all_pairs else None, []
    for start in range(0, count if len(places) else 0, _BLOCK):
        part = slice(start, start + _BLOCK)
        apart_m = _apart_m(places, query.drive, part, rules)
        left_out, usable = np.isinf(apart_m), query.usable[part]
        without = left_out[usable] if rules.exclusion_ns else None
        rows, similar = np.zeros((len(usable), depth), np.intp), np.full((len(usable), depth), np.nan)
        rows[usable], similar[usable] = index.search_many(query.means[part][usable], depth, without)
        if pairs:
            squares = np.full(apart_m.shape, np.inf)
            squares[usable] = index.squared_distances(query.means[part][usable])
            squares[left_out] = np.inf
            pairs.add(squares, apart_m <= rules.tolerance_m, ~left_out & (apart_m > rules.negative_m))
        near = (np.take_along_axis(apart_m, rows, 1) <= rules.tolerance_m) & np.isfinite(similar)
        ranks[part] = np.where(near.any(axis=1), np.argmax(near, axis=1), NOT_FOUND)
        found[part], nearest[part] = rows[:, 0], apart_m.argmin(axis=1)
        errors_m[part] = np.take_along_axis(apart_m, rows[:, :1], 1)[:, 0]
        distances[part] = similar[:, 0]
        positive[part] = apart_m.min(axis=1) <= rules.tolerance_m
        if with_signals:
            known = np.isfinite(distances[part])
            signals.append(
                Signals(
                    evidence_table(
                        places,
                        query.means[part][known],
                        query.uncertainties[part][known],
                        rules.tolerance_m,
                        left_out[known] if rules.exclusion_ns else None,
                    ),
                    similar[known, 1] if depth > 1 else np.full(int(known.sum()), np.inf),
                    spatial_variance(similar[known], places.positions_m[rows[known], :2]),
                )
            )
    return Answers(
        pair,
        len(places),
        query.uncertainties,
        ranks,
        positive,
        errors_m,
        distances,
        found,
        nearest,
        query.drive.kinds,
        query.drive.severities,
        pairs.level() if pairs else None,
        joined_signals(signals) if signals else None,
    )


def joined_signals(several: Sequence[Signals]) -> Signals:
    """The rows of several signals (at least one), one after the other."""
    evidence, second, variance_m2 = zip(*several, strict=True)
    return Signals(joined_evidence(evidence), np.concatenate(second), np.concatenate(variance_m2))


def search_drive_map(
    pair: Pair, mapped: EmbeddedDrive, query: EmbeddedDrive, rules: Rules, stretch_m: float = 0.0
) -> Answers:
    """Search the map of one drive for every scan of another; `found` and `nearest` are rows of the mapped drive.

    `stretch_m` is as in `left_out.stretch_m`. A query also has a positive where the encoder refused the scan of that
    place, so that all methods have the same queries. A map without places answers no query.
    """
    rows = rows_in_map(mapped.drive, map_rows(mapped, pair.spacing_m), pair.map_number, stretch_m)
    searched = search_places(pair, places_of(mapped, rows), query, rules, all_pairs=True, with_signals=True)
    if not mapped.usable.all():
        whole = dataclasses.replace(mapped, uncertainties=np.zeros(len(mapped.uncertainties)))
        kept = rows_in_map(mapped.drive, map_rows(whole, pair.spacing_m), pair.map_number, stretch_m)
        searched = dataclasses.replace(searched, positive=_positive(places_of(whole, kept), query, rules))
    if not len(rows):
        return searched
    return dataclasses.replace(searched, found=rows[searched.found], nearest=rows[searched.nearest])


def _apart_m(places: PlaceTable, drive: Drive, part: slice, rules: Rules) -> NDArray[np.float64]:
    """(B, P) metres from where B scans of a drive were taken to P places; infinite where a place is left out."""
    apart_m = distances_m(drive.poses[part, :2], places.positions_m[:, :2])
    if rules.exclusion_ns:
        late_ns = np.abs(places.stamps_ns - drive.stamps_ns[part, np.newaxis])
        apart_m[late_ns <= rules.exclusion_ns] = np.inf
    return apart_m


def _positive(places: PlaceTable, query: EmbeddedDrive, rules: Rules) -> NDArray[np.bool_]:
    """(Q,) whether the map holds a positive, which is that of a place whose scan the encoder refused, too."""
    if not len(places):
        return np.zeros(len(query.means), np.bool_)
    parts = [slice(start, start + _BLOCK) for start in range(0, len(query.means), _BLOCK)]
    nearest_m = [_apart_m(places, query.drive, part, rules).min(axis=1) for part in parts]
    return np.asarray(np.concatenate(nearest_m) <= rules.tolerance_m)
