"""Every scan of one drive searched for in the map of another, and whether its answer is correct."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.distances import distances_m
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.metrics.pair_level import PairDistances, PairLevel
from offradar_ros.recordings.spacing import subsample_by_distance
from offradar_ros.retrieval.place_index import PlaceIndex
from offradar_ros.types import PlaceTable

DEPTH = 10
"""Number of nearest places of each query that are evaluated."""

NOT_FOUND = 1_000_000
"""Rank of a query with no positive among them."""

_BLOCK = 256


@dataclasses.dataclass(frozen=True)
class Pair:
    """An ordered pair of drives: `map_index` is mapped and `query_index` searched for, both drives of `world`."""

    method: str
    group: str
    world: str
    map_index: int
    query_index: int
    spacing_m: float


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

    @property
    def correct(self) -> NDArray[np.bool_]:
        """(Q,) whether the place found is a positive."""
        correct: NDArray[np.bool_] = self.ranks == 0
        return correct


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
    depth: int = DEPTH,
) -> Answers:
    """Search the places (ids 0, 1, …) for every scan of `query`, and evaluate the `depth` nearest of each.

    `all_pairs` also computes `pair_level`, which doubles the time.
    """
    count, depth = len(query.means), min(depth, len(places))
    index = PlaceIndex(places.means.shape[1], len(places))
    index.upsert(places)
    ranks = np.full(count, NOT_FOUND, np.int64)
    found, nearest = np.zeros((2, count), np.int64)
    errors_m, distances = np.full((2, count), np.inf)
    positive = np.zeros(count, np.bool_)
    pairs = PairDistances() if all_pairs else None
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
    )


def search_drive_map(pair: Pair, mapped: EmbeddedDrive, query: EmbeddedDrive, rules: Rules) -> Answers:
    """Search the map of one drive for every scan of another; `found` and `nearest` are rows of the mapped drive.

    A query also has a positive where the encoder refused the scan of that place, so that all methods have the same
    queries. A map without places answers no query.
    """
    rows = map_rows(mapped, pair.spacing_m)
    searched = search_places(pair, places_of(mapped, rows), query, rules, all_pairs=True)
    if not mapped.usable.all():
        searched = dataclasses.replace(searched, positive=_positive(mapped, pair.spacing_m, query, rules))
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


def _positive(mapped: EmbeddedDrive, spacing_m: float, query: EmbeddedDrive, rules: Rules) -> NDArray[np.bool_]:
    """(Q,) whether the map would hold a positive if the encoder had refused no scan."""
    whole = dataclasses.replace(mapped, uncertainties=np.zeros(len(mapped.uncertainties)))
    places = places_of(whole, map_rows(whole, spacing_m))
    parts = [slice(start, start + _BLOCK) for start in range(0, len(query.means), _BLOCK)]
    nearest_m = [_apart_m(places, query.drive, part, rules).min(axis=1) for part in parts]
    return np.asarray(np.concatenate(nearest_m) <= rules.tolerance_m)
