"""Queries on and off the map: a part of the road is left out of the map, and places of other roads may be added."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.open_set import halves, open_answers
from offradar_ros.lab.evaluation.answers import map_rows, places_of
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.retrieval.evidence import EvidenceTable
from offradar_ros.types import PlaceTable

_APART_M = 1e6
"""Distance between the frames of worlds that share a map: far beyond any tolerance."""


class OpenSet(NamedTuple):
    """Queries of one drive in a map of another, of which a part is left out.

    Attributes:
        group, world: of the protocol.
        places: size of the map.
        evidence: one row for each of Q usable scans of the query drive.
        right: (Q,) whether the nearest place is within the tolerance of the scan.
        on_map: (Q,) whether any place is.
        degraded: (Q,) whether the scan is degraded.
    """

    group: str
    world: str
    places: int
    evidence: EvidenceTable
    right: NDArray[np.bool_]
    on_map: NDArray[np.bool_]
    degraded: NDArray[np.bool_]


def other_roads(worlds: Sequence[Sequence[EmbeddedDrive]], spacing_m: float) -> PlaceTable:
    """The places of drives of other worlds, each world in a frame of its own, to be added to a map."""
    tables = []
    for number, drives in enumerate(worlds):
        for drive in drives:
            table = places_of(drive, map_rows(drive, spacing_m))
            table.positions_m[:, 0] += _APART_M * (number + 1)
            tables.append(table)
    return _joined(tables)


def _joined(tables: Sequence[PlaceTable]) -> PlaceTable:
    columns = [
        np.concatenate([getattr(table, name) for table in tables])
        for name in ('session_ids', 'stamps_ns', 'positions_m', 'yaws_rad', 'yaw_sds_rad', 'uncertainties', 'means')
    ]
    return PlaceTable(np.arange(len(columns[0]), dtype=np.int64), *columns)


def open_sets(
    drives: Sequence[EmbeddedDrive],
    spacing_m: float,
    tolerance_m: float,
    others: PlaceTable | None = None,
) -> Iterator[OpenSet]:
    """Every ordered pair of drives of one world, with either half of the mapped road left out."""
    for mapped, query in itertools.permutations(drives, 2):
        for rows in halves(mapped.drive.driven_m, map_rows(mapped, spacing_m)):
            if not len(rows):
                continue
            places = places_of(mapped, rows)
            yield open_set(places if others is None else _joined([places, others]), mapped, query, tolerance_m)


def open_set(places: PlaceTable, mapped: EmbeddedDrive, query: EmbeddedDrive, tolerance_m: float) -> OpenSet:
    """The usable scans of a drive as queries of a map, in one frame."""
    usable = query.usable
    found = open_answers(
        places,
        query.means[usable],
        query.uncertainties[usable],
        query.drive.poses[usable, :2],
        tolerance_m,
    )
    return OpenSet(
        mapped.drive.group,
        mapped.drive.world,
        len(places),
        *found,
        query.drive.kinds[usable] != '',
    )
