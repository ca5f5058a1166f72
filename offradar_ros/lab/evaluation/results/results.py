"""Everything that an evaluation gives."""

from __future__ import annotations

import dataclasses
from typing import TypeVar

from offradar_ros.lab.evaluation.protocol import ALL, Protocol
from offradar_ros.lab.evaluation.results.ablation import AblationFigures
from offradar_ros.lab.evaluation.results.method import MethodRecord
from offradar_ros.lab.evaluation.results.provenance import Machine
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.results.searches import DriveRecord, MaintainedMap, Search
from offradar_ros.lab.evaluation.results.uncertainty import RecordedUncertainty, UncertaintyFigures

FiguresT = TypeVar('FiguresT')

ByMap = dict[str, dict[str, dict[str, FiguresT]]]
"""Figures by group, then by `spacing_key`, then by method."""


def spacing_key(spacing_m: float) -> str:
    """Name of maps with a place every so many metres: ``5``, ``0`` where every scan is mapped."""
    return f'{spacing_m:g}'


@dataclasses.dataclass(frozen=True)
class Results:
    """Every figure of an evaluation, and all that is needed to measure it again.

    The groups of `groups`, `uncertainty` and `maintenance` are those of the protocol that were measured, and ``all`` of
    them together.

    Attributes:
        created: date and time, ISO 8601.
        command: that measured it.
        versions: of the software.
        machine: that ran it.
        protocol: what was measured.
        splits: source of each split that the protocol names.
        seeds: of every world and of the evaluation.
        skipped: in words, what of the protocol was not measured.
        drives: in the order of their worlds.
        worlds: that were searched, sorted.
        methods: by name.
        groups: figures of searches.
        uncertainty: of U, by group and method.
        maintenance: of maintained maps; methods that are fitted to each map have none.
        recorded: U of recorded scans, where it was measured.
        searches: in the order in which the scans' file counts them.
        kinds: of what is wrong with scans, in the order in which the scans' file counts them.
        maps: in the order in which the maps' file counts them.
        rows: of the scans' file.
    """

    created: str
    command: str
    versions: dict[str, str]
    machine: Machine
    protocol: Protocol
    splits: dict[str, str]
    seeds: tuple[int, ...]
    skipped: tuple[str, ...]
    drives: tuple[DriveRecord, ...]
    worlds: tuple[str, ...]
    methods: dict[str, MethodRecord]
    groups: ByMap[SearchFigures]
    uncertainty: dict[str, dict[str, UncertaintyFigures]]
    maintenance: ByMap[AblationFigures]
    recorded: RecordedUncertainty | None
    searches: tuple[Search, ...]
    kinds: tuple[str, ...]
    maps: tuple[MaintainedMap, ...]
    rows: int

    def title(self, group: str) -> str:
        """What people call a group."""
        titles = {known.name: known.title for known in self.protocol.groups}
        return titles.get(group, 'All groups')

    def scans(self, group: str) -> str:
        """What the scans of a group are, in words: simulated, recorded or both."""
        kinds = {known.scans for known in self.protocol.groups if group in (ALL, known.name)}
        return kinds.pop() if len(kinds) == 1 else 'simulated and recorded scans'
