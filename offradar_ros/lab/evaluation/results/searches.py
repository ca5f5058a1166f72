"""The drives of an evaluation, and which of them were searched for in the map of which."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.answers import Pair
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class DriveRecord:
    """A drive of the evaluation.

    Attributes:
        group: of the protocol.
        world: name of the world.
        index: of the drive in its world, as in `Pair`.
        name: of the drive.
        scans: number of scans.
        path_length_m: from the first to the last scan.
        roles: ``mapped and searched``, ``mapped``, ``searched`` or ``validation``.
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
    """One search, whose queries are rows of ``scans.npy``; `maintained`: whether the map was maintained."""

    pair: Pair
    maintained: bool


@dataclasses.dataclass(frozen=True)
class MaintainedMap:
    """A map that is kept in ``maps.npz`` before and after maintenance: that of the first ordered pair of a world.

    Attributes:
        pair: of drives.
        opportunities: number of merged scans with a place within D_t.
        replaced: number of those that replaced the place.
    """

    pair: Pair
    opportunities: int
    replaced: int
