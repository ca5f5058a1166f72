"""The paper's ablation of the system: maintained maps (M), introspective querying (Q), both (QM) or neither (O).

For three drives A, B, C of a world the map is made of A, drive B is merged into it, and C, which was never merged, is
searched for; then the same with the drives rotated. The map keeps its size: a scan of B replaces the place nearest to
it, or none. The control replaces as many times, at opportunities drawn at random, so that what M gains is not just what
newer or mixed scans would.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import MapConfig
from offradar_ros.evaluation.answers import Answers, Pair, answers, map_rows
from offradar_ros.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.evaluation.protocol import Maintenance
from offradar_ros.mapping.parent_map import MergeKind, ParentMap
from offradar_ros.types import Embedding, PlaceTable, Pose


@dataclasses.dataclass(frozen=True, eq=False)
class Ablation:
    """One rotation of a world's drives: answers from the map as it was, maintained, and replaced at random.

    `opportunities` scans of the merged drive had a place within D_t, `replaced` of them took it over.
    """

    unmaintained: Answers
    maintained: Answers
    random: tuple[Answers, ...]
    opportunities: int
    replaced: int


def rotations(drives: Sequence[EmbeddedDrive]) -> Iterator[tuple[EmbeddedDrive, list[EmbeddedDrive], EmbeddedDrive]]:
    """(mapped, merged, query) for each rotation: the last is searched for, those between are merged in order."""
    for first in range(len(drives)):
        mapped, *merged, query = [*drives[first:], *drives[:first]]
        yield mapped, merged, query


def ablate(
    pair: Pair,
    mapped: EmbeddedDrive,
    merged: Sequence[EmbeddedDrive],
    query: EmbeddedDrive,
    plan: Maintenance,
    tolerance_m: float,
    seed: int,
) -> Ablation:
    """Answers for `query` from the three kinds of maps, all of the same number of places."""
    start = map_rows(mapped, pair.spacing_m)
    scans = [(drive, row) for drive in merged for row in np.flatnonzero(drive.usable).tolist()]

    def ask(table: PlaceTable) -> Answers:
        return answers(pair, table.means, table.positions_m[:, :2], query, tolerance_m)

    parent = _map_of(mapped, start, mapped.uncertainties, plan)
    unmaintained = ask(parent.table())
    places_m = mapped.drive.poses[start, :2]
    chances = [scan for scan in scans if _in_reach(places_m, *scan, plan.match_distance_m)]
    replaced = 0
    for drive, row in chances:
        merge = parent.merge(_embedding(drive, row, drive.uncertainties[row]), _pose(drive, row), 2)
        replaced += merge.kind is MergeKind.REPLACED
    rng = np.random.default_rng([seed, len(chances)])
    control = []
    for _ in range(plan.random_repeats):
        drawn = np.sort(rng.permutation(len(chances))[:replaced])
        control.append(ask(_replaced_at(mapped, start, [chances[i] for i in drawn], plan).table()))
    return Ablation(unmaintained, ask(parent.table()), tuple(control), len(chances), replaced)


def _replaced_at(
    mapped: EmbeddedDrive, start: NDArray[np.intp], scans: Sequence[tuple[EmbeddedDrive, int]], plan: Maintenance
) -> ParentMap:
    """The map after each of `scans` took its place over, whatever its U: each pretends to be surer than the last."""
    parent = _map_of(mapped, start, np.ones(len(mapped.drive)), plan)
    for number, (drive, row) in enumerate(scans, start=1):
        parent.merge(_embedding(drive, row, 1.0 / (number + 1)), _pose(drive, row), 2)
    return parent


def _map_of(
    drive: EmbeddedDrive, rows: NDArray[np.intp], uncertainties: NDArray[np.float64], plan: Maintenance
) -> ParentMap:
    """A map of just these scans; `load` keeps them apart where they are nearer than D_t."""
    count, dimension = len(rows), drive.means.shape[1]
    config = MapConfig(match_distance_m=plan.match_distance_m, insert_unmatched=False)
    parent = ParentMap(config, dimension)
    positions_m = np.column_stack([drive.drive.poses[rows, :2], np.zeros(count)])
    table = PlaceTable(
        np.arange(count, dtype=np.int64),
        np.ones(count, np.int32),
        drive.drive.stamps_ns[rows],
        positions_m,
        drive.drive.poses[rows, 2],
        uncertainties[rows].astype(np.float32),
        drive.means[rows],
    )
    parent.load(table, positions_m[:, :2], count)
    return parent


def _in_reach(places_m: NDArray[np.float64], drive: EmbeddedDrive, row: int, distance_m: float) -> bool:
    """Whether one of (P, 2) places is within D_t of the scan."""
    return bool((np.hypot(*(places_m - drive.drive.poses[row, :2]).T) < distance_m).any())


def _embedding(drive: EmbeddedDrive, row: int, uncertainty: float) -> Embedding:
    mean = drive.means[row]
    return Embedding(int(drive.drive.stamps_ns[row]), mean, np.full(len(mean), uncertainty, np.float32))


def _pose(drive: EmbeddedDrive, row: int) -> Pose:
    x_m, y_m, yaw_rad = drive.drive.poses[row].tolist()
    return Pose(x_m, y_m, 0.0, yaw_rad)
