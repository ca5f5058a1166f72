"""The paper's ablation of the system: maintained maps (M), introspective querying (Q), both (QM) or neither (O).

The map is made of one drive, all others but the query drive are merged into it, and the query drive, which was never
merged, is searched for; so for every ordered pair of drives. The map is the vehicle's own `ParentMap` of constant size:
a merged scan replaces the place nearest to it, or none. The control (M_random) replaces as many times, at opportunities
drawn at random, so that what M gains is not just what newer or mixed scans would.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import MapConfig
from offradar_ros.lab.evaluation.answers import Answers, Rules, answers, map_rows, places_of
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol import Maintenance
from offradar_ros.mapping.parent_map import MergeKind, ParentMap
from offradar_ros.mapping.place_columns import PlaceColumns, take_rows
from offradar_ros.types import PlaceTable


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
    scans = _joined([places_of(drive, np.flatnonzero(drive.usable)) for drive in merged])
    parent = ParentMap(MapConfig(match_distance_m=plan.match_distance_m, insert_unmatched=False), before.means.shape[1])
    parent.load(_columns(before), before.positions_m[:, :2], len(before))
    merges = parent.merge_all(scans, session_id=2)
    after = parent.table()
    opportunities, replaced = np.flatnonzero(merges.nearest >= 0), merges.kinds.count(MergeKind.REPLACED)
    rng = np.random.default_rng([seed, len(opportunities)])
    control = []
    for _ in range(plan.random_repeats):
        drawn = opportunities[np.sort(rng.permutation(len(opportunities))[:replaced])]
        mixed = _columns(before)
        mixed.upsert(dataclasses.replace(take_rows(scans, drawn), place_ids=merges.nearest[drawn]))
        control.append(answers(pair, mixed.table, query, rules, depth=1))
    maintained = dataclasses.replace(answers(pair, after, query, rules), positive=unmaintained.positive)
    return Ablation(
        unmaintained, maintained, tuple(control), len(opportunities), replaced, _picture(before), _picture(after)
    )


def _joined(tables: Sequence[PlaceTable]) -> PlaceTable:
    names = [field.name for field in dataclasses.fields(PlaceTable)]
    return PlaceTable(*(np.concatenate([getattr(table, name) for table in tables]) for name in names))


def _columns(places: PlaceTable) -> PlaceColumns:
    """A copy of these places that can be changed."""
    columns = PlaceColumns(places.means.shape[1], len(places))
    columns.upsert(places)
    return columns


def _picture(table: PlaceTable) -> NDArray[np.float64]:
    return np.column_stack([table.positions_m[:, :2], table.uncertainties]).astype(np.float64)
