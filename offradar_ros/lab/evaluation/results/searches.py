"""Which drives there were, and which of them were searched for in the map of which."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.answers import Pair
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class DriveRecord:
    """A drive of the evaluation.

    Attributes:
        group: of the protocol.
        world: the frame that it shares with others.
        index: which of the world's drives; `Pair` counts by it.
        name: for people.
        scans: number of them.
        path_length_m: metres driven from the first to the last scan.
        roles: what it was for: ``mapped and searched``, ``mapped``, ``searched`` or ``validation``.
    """

    group: str
    world: str
    index: int
    name: str
    scans: int
    path_length_m: Measure
    roles: str


@dataclasses.dataclass(frozen=True)
class Search:
    """One search, whose queries are rows of the scans' file: `maintained` says whether the map was."""

    pair: Pair
    maintained: bool


@dataclasses.dataclass(frozen=True)
class MaintainedMap:
    """The first ordered pair of a world, whose map is kept before and after it was maintained.

    Attributes:
        pair: of drives.
        opportunities: merged scans that had a place within D_t.
        replaced: those of them that took the place over.
    """

    pair: Pair
    opportunities: int
    replaced: int
