"""The paper's ablation of the system: maintained maps (M), introspective querying (Q), both (QM) or neither (O).

The map is made of one drive, all others but the query drive are merged into it, and the query drive, which was never
merged, is searched for; so for every ordered pair of drives. The map keeps its size: a merged scan replaces the place
nearest to it, or none. The control replaces as many times, at opportunities drawn at random, so that what M gains is
not just what newer or mixed scans would.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.evaluation.answers import Answers, Rules, answers, map_rows, places_of
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol import Maintenance
from offradar_ros.mapping.place_columns import take_rows
from offradar_ros.types import PlaceTable

_BLOCK = 512


@dataclasses.dataclass(frozen=True, eq=False)
class Ablation:
    """One ordered pair: answers from the map as it was, maintained, and replaced at random.

    `opportunities` scans of the merged drives had a place within D_t, `replaced` of them took it over; `before` and
    `after` are (P, 3) float64: x and y in metres of the scan that each place holds, and its U.
    """

    unmaintained: Answers
    maintained: Answers
    random: tuple[Answers, ...]
    opportunities: int
    replaced: int
    before: NDArray[np.float64]
    after: NDArray[np.float64]


def merges(drives: Sequence[EmbeddedDrive]) -> Iterator[tuple[EmbeddedDrive, list[EmbeddedDrive], EmbeddedDrive]]:
    """(mapped, merged, query) for each ordered pair of drives; every other drive of which maps are made is merged."""
    for mapped, query in itertools.permutations(drives, 2):
        merged = [d for d in drives if d.drive.mapped and d is not mapped and d is not query]
        if merged and mapped.drive.mapped and query.drive.queried:
            yield mapped, merged, query


def ablate(
    unmaintained: Answers,
    mapped: EmbeddedDrive,
    merged: Sequence[EmbeddedDrive],
    query: EmbeddedDrive,
    plan: Maintenance,
    rules: Rules,
    seed: int,
) -> Ablation:
    """Answers for `query` from the maintained map and the control, both of as many places as the `unmaintained` one.

    Queries count as having a right place where they have one in that.
    """
    pair = unmaintained.pair
    before = places_of(mapped, map_rows(mapped, pair.spacing_m))
    scans = [places_of(drive, np.flatnonzero(drive.usable)) for drive in merged]
    chances, matches = opportunities(before, scans, plan.match_distance_m)
    holders, replaced = most_certain(before.uncertainties, chances.uncertainties, matches)
    after = with_scans(before, chances, holders)
    rng = np.random.default_rng([seed, len(matches)])
    control = []
    for _ in range(plan.random_repeats):
        drawn = np.sort(rng.permutation(len(matches))[:replaced])
        holders = np.full(len(before), -1)
        holders[matches[drawn]] = drawn
        control.append(answers(pair, with_scans(before, chances, holders), query, rules, depth=1))
    maintained = dataclasses.replace(answers(pair, after, query, rules), positive=unmaintained.positive)
    return Ablation(unmaintained, maintained, tuple(control), len(matches), replaced, _picture(before), _picture(after))


def opportunities(
    places: PlaceTable, scans: Sequence[PlaceTable], distance_m: float
) -> tuple[PlaceTable, NDArray[np.intp]]:
    """The scans that have a place within D_t, in their order, and (C,) the row of the place nearest to each.

    A place stays where it was first mapped (`map.match_position: anchor`).
    """
    several = PlaceTable(*(np.concatenate(columns) for columns in zip(*map(_columns, scans), strict=True)))
    nearest = np.empty(len(several), np.intp)
    apart_m = np.empty(len(several))
    for start in range(0, len(several) if len(places) else 0, _BLOCK):
        part = slice(start, start + _BLOCK)
        offsets = several.positions_m[part, None, :2] - places.positions_m[None, :, :2]
        squares = np.einsum('spk,spk->sp', offsets, offsets)
        nearest[part] = squares.argmin(axis=1)
        apart_m[part] = np.sqrt(squares.min(axis=1))
    near = np.flatnonzero(apart_m < distance_m) if len(places) else np.empty(0, np.intp)
    return take_rows(several, near), nearest[near]


def most_certain(
    held: NDArray[np.float32], uncertainties: NDArray[np.float32], matches: NDArray[np.intp]
) -> tuple[NDArray[np.intp], int]:
    """Algorithm 1 for a map of constant size: which of the (C,) scans each place holds, and how often one was replaced.

    The first is (P,) int, −1 for its own. `held` is U of the (P,) places, `matches` the place that each scan may
    replace. `mapping.ParentMap` comes to the same, place for place; it also takes scans one by one, and so takes far
    longer.
    """
    lowest, holders, replaced = held.tolist(), np.full(len(held), -1), 0
    for scan, (place, uncertainty) in enumerate(zip(matches.tolist(), uncertainties.tolist(), strict=True)):
        if uncertainty < lowest[place]:
            lowest[place], holders[place] = uncertainty, scan
            replaced += 1
    return holders, replaced


def with_scans(places: PlaceTable, scans: PlaceTable, holders: NDArray[np.intp]) -> PlaceTable:
    """The map in which each place holds the scan that `holders` says, or its own where that is −1."""
    taken = np.flatnonzero(holders >= 0)
    columns = [column.copy() for column in _columns(places)]
    for column, other in zip(columns, _columns(scans), strict=True):
        column[taken] = other[holders[taken]]
    return dataclasses.replace(PlaceTable(*columns), place_ids=places.place_ids)


def _columns(table: PlaceTable) -> list[NDArray[Any]]:
    return [getattr(table, field.name) for field in dataclasses.fields(table)]


def _picture(table: PlaceTable) -> NDArray[np.float64]:
    return np.column_stack([table.positions_m[:, :2], table.uncertainties]).astype(np.float64)
