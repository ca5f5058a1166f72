"""The paper's ablation of the system: maintained maps (M), introspective querying (Q), both (QM) or neither (O).

For every ordered pair of drives, the map is made of the first, all other drives are merged into it, and the second,
which is never merged, is searched for. The map is the vehicle's `ParentMap` at constant size: a merged scan replaces
the nearest place, or none. The control (M_random) makes as many replacements at opportunities drawn at random: it
shows what newer or mixed scans gain by themselves.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import MapConfig
from offradar_ros.lab.evaluation.answers import Answers, Rules, map_rows, places_of, search_places
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol import Maintenance
from offradar_ros.mapping.parent_map import MergeKind, ParentMap
from offradar_ros.mapping.place_columns import PlaceColumns, take_rows
from offradar_ros.types import PlaceTable


@dataclasses.dataclass(frozen=True, eq=False)
class Ablation:
    """The ablation of one ordered pair of drives.

    Attributes:
        unmaintained: answers from the map of one drive.
        maintained: answers from that map after all other drives were merged into it.
        random: answers from maps of the control, one for each draw.
        opportunities: number of merged scans with a place within D_t.
        replaced: number of those that replaced the place.
        before: (P, 3) float64 x, y in metres and U of the scan that each place of the unmaintained map holds.
        after: the same of the maintained map.
    """

    unmaintained: Answers
    maintained: Answers
    random: tuple[Answers, ...]
    opportunities: int
    replaced: int
    before: NDArray[np.float64]
    after: NDArray[np.float64]


def merge_plans(drives: Sequence[EmbeddedDrive]) -> Iterator[tuple[EmbeddedDrive, list[EmbeddedDrive], EmbeddedDrive]]:
    """(mapped, merged, query) for each ordered pair of drives; `merged` are all other drives of which maps are made."""
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
    """Answers for `query` from the maintained map and the control, which have as many places as the unmaintained map.

    `positive` of all answers is that of the `unmaintained` ones.
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
        control.append(search_places(pair, mixed.table, query, rules, depth=1))
    maintained = dataclasses.replace(search_places(pair, after, query, rules), positive=unmaintained.positive)
    return Ablation(
        unmaintained,
        maintained,
        tuple(control),
        len(opportunities),
        replaced,
        _positions_and_uncertainties(before),
        _positions_and_uncertainties(after),
    )


def _joined(tables: Sequence[PlaceTable]) -> PlaceTable:
    names = [field.name for field in dataclasses.fields(PlaceTable)]
    return PlaceTable(*(np.concatenate([getattr(table, name) for table in tables]) for name in names))


def _columns(places: PlaceTable) -> PlaceColumns:
    """A copy of the places that can be changed."""
    columns = PlaceColumns(places.means.shape[1], len(places))
    columns.upsert(places)
    return columns


def _positions_and_uncertainties(table: PlaceTable) -> NDArray[np.float64]:
    return np.column_stack([table.positions_m[:, :2], table.uncertainties]).astype(np.float64)
