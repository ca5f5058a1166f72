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

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import MapConfig
from offradar_ros.evaluation.answers import Answers, Pair, Rules, answers, map_rows, places_of
from offradar_ros.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.evaluation.protocol import Maintenance
from offradar_ros.mapping.parent_map import MergeKind, ParentMap
from offradar_ros.types import Embedding, PlaceTable, Pose


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
    pair: Pair,
    mapped: EmbeddedDrive,
    merged: Sequence[EmbeddedDrive],
    query: EmbeddedDrive,
    plan: Maintenance,
    rules: Rules,
    seed: int,
) -> Ablation:
    """Answers for `query` from the three kinds of maps, all of the same number of places."""
    start = places_of(mapped, map_rows(mapped, pair.spacing_m))
    parent = _map_of(start, plan)
    before = parent.table()
    chances = [(drive, row) for drive in merged for row in _in_reach(start, drive, plan.match_distance_m)]
    replaced = 0
    for drive, row in chances:
        merge = parent.merge(_embedding(drive, row, drive.uncertainties[row]), _pose(drive, row), 2)
        replaced += merge.kind is MergeKind.REPLACED
    rng = np.random.default_rng([seed, len(chances)])
    control = []
    for _ in range(plan.random_repeats):
        drawn = np.sort(rng.permutation(len(chances))[:replaced])
        table = _replaced_at(start, [chances[i] for i in drawn], plan)
        control.append(answers(pair, table, query, rules))
    after = parent.table()
    told = [answers(pair, table, query, rules) for table in (before, after)]
    return Ablation(told[0], told[1], tuple(control), len(chances), replaced, _picture(before), _picture(after))


def _picture(table: PlaceTable) -> NDArray[np.float64]:
    return np.column_stack([table.positions_m[:, :2], table.uncertainties]).astype(np.float64)


def _replaced_at(start: PlaceTable, scans: Sequence[tuple[EmbeddedDrive, int]], plan: Maintenance) -> PlaceTable:
    """The map after each of `scans` took its place over, whatever its U: each pretends to be surer than the last."""
    parent = _map_of(dataclasses.replace(start, uncertainties=np.ones(len(start), np.float32)), plan)
    for number, (drive, row) in enumerate(scans, start=1):
        parent.merge(_embedding(drive, row, 1.0 / (number + 1)), _pose(drive, row), 2)
    return parent.table()


def _map_of(places: PlaceTable, plan: Maintenance) -> ParentMap:
    """A map of just these scans; `load` keeps them apart where they are nearer than D_t."""
    config = MapConfig(match_distance_m=plan.match_distance_m, insert_unmatched=False)
    parent = ParentMap(config, places.means.shape[1])
    parent.load(places, places.positions_m[:, :2], len(places))
    return parent


def _in_reach(places: PlaceTable, drive: EmbeddedDrive, distance_m: float) -> list[int]:
    """Usable scans of a drive with a place within D_t."""
    usable = np.flatnonzero(drive.usable)
    near = []
    for row, (x_m, y_m) in zip(usable.tolist(), drive.drive.poses[usable, :2].tolist(), strict=True):
        if np.hypot(places.positions_m[:, 0] - x_m, places.positions_m[:, 1] - y_m).min() < distance_m:
            near.append(row)
    return near


def _embedding(drive: EmbeddedDrive, row: int, uncertainty: float) -> Embedding:
    mean = drive.means[row]
    return Embedding(int(drive.drive.stamps_ns[row]), mean, np.full(len(mean), uncertainty, np.float32))


def _pose(drive: EmbeddedDrive, row: int) -> Pose:
    x_m, y_m, yaw_rad = drive.drive.poses[row].tolist()
    return Pose(x_m, y_m, 0.0, yaw_rad)
