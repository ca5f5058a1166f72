"""The results of an evaluation."""

from __future__ import annotations

import dataclasses
from typing import TypeVar

from offradar_ros.lab.evaluation.protocol import ALL, Protocol
from offradar_ros.lab.evaluation.results.ablation import AblationFigures
from offradar_ros.lab.evaluation.results.alignments import AlignmentFigures
from offradar_ros.lab.evaluation.results.method import MethodRecord
from offradar_ros.lab.evaluation.results.provenance import Machine
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.results.searches import DriveRecord, MaintainedMap, Search
from offradar_ros.lab.evaluation.results.uncertainty import RecordedUncertainty, UncertaintyFigures

FiguresT = TypeVar('FiguresT')

ByMap = dict[str, dict[str, dict[str, FiguresT]]]
"""Figures by group, then by `spacing_key`, then by method."""


def spacing_key(spacing_m: float) -> str:
    """Key of a map spacing in metres: ``5``; ``0`` if every scan is mapped."""
    return f'{spacing_m:g}'


@dataclasses.dataclass(frozen=True)
class Results:
    """Every figure of an evaluation, and everything that is needed to repeat it.

    The keys of `groups`, `uncertainty`, `maintenance` and `alignments` are the groups that were measured, and ``all``
    for all groups together.

    Attributes:
        created: date and time, ISO 8601.
        command: the command line.
        versions: of the software.
        machine: that ran the command.
        protocol: what was measured.
        splits: source of each split that the protocol names.
        seeds: of every world and of the evaluation.
        skipped: notes on what was not measured.
        drives: in the order of their worlds.
        worlds: names of those that were searched, sorted.
        methods: models, thresholds and costs, by name.
        groups: figures of searches.
        uncertainty: distribution of U, by group and method.
        maintenance: figures of maintained maps; methods that are fitted to each map have none.
        recorded: U of recorded scans; None if not measured.
        searches: which `pair` of ``scans.npy`` is an index of.
        kinds: kinds of degradation, which `kind` of ``scans.npy`` is an index of.
        maps: which the K of the arrays of ``maps.npz`` is an index of.
        rows: number of rows of ``scans.npy``.
        alignments: figures of queries that were aligned with the places found; methods that are fitted to each map
            have none. Empty if none was aligned, and in files of earlier versions.
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
    alignments: ByMap[AlignmentFigures] = dataclasses.field(default_factory=dict)

    def title(self, group: str) -> str:
        """Title of a group."""
        titles = {known.name: known.title for known in self.protocol.groups}
        return titles.get(group, 'All groups')

    def scans(self, group: str) -> str:
        """``simulated scans``, ``recorded scans`` or both, in words."""
        kinds = {known.scans for known in self.protocol.groups if group in (ALL, known.name)}
        return kinds.pop() if len(kinds) == 1 else 'simulated and recorded scans'
