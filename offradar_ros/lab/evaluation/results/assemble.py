"""The results of an evaluation from what was measured."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.ablation_summary import summarise_ablation
from offradar_ros.lab.evaluation.aligned import joined_answers
from offradar_ros.lab.evaluation.alignment_figures import alignment_figures
from offradar_ros.lab.evaluation.alignments import AlignedPair
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.protocol import ALL, VALIDATION, Protocol
from offradar_ros.lab.evaluation.results.ablation import AblationFigures
from offradar_ros.lab.evaluation.results.alignments import AlignmentFigures
from offradar_ros.lab.evaluation.results.arrays import MapArrays, ScanRows
from offradar_ros.lab.evaluation.results.method import MethodRecord
from offradar_ros.lab.evaluation.results.provenance import this_machine, versions
from offradar_ros.lab.evaluation.results.results import Results, spacing_key
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.results.searches import DriveRecord
from offradar_ros.lab.evaluation.results.uncertainty import RecordedUncertainty
from offradar_ros.lab.evaluation.runner import Measured, Worlds
from offradar_ros.lab.evaluation.summary import describe_uncertainty, summarise
from offradar_ros.recordings.datasets.splits import read_split


def assemble(
    measured: Sequence[Measured],
    worlds: Worlds,
    protocol: Protocol,
    rows: ScanRows,
    maps: MapArrays,
    *,
    command: str = '',
    skipped: Sequence[str] = (),
    recorded: RecordedUncertainty | None = None,
    aligned: Mapping[str, Sequence[AlignedPair]] | None = None,
) -> Results:
    """The results; `rows` and `maps` are the arrays that are written with them, `aligned` is by method."""
    groups = [g.name for g in protocol.groups if any(a.pair.group == g.name for m in measured for a in m.answers)]
    named = [*groups, ALL]
    splits = {road.split for group in protocol.groups for road in group.recorded if road.split}
    return Results(
        created=datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds'),
        command=command,
        versions=versions(),
        machine=this_machine(),
        protocol=protocol,
        splits={split: read_split(split).source for split in sorted(splits)},
        seeds=_seeds(protocol),
        skipped=tuple(skipped),
        drives=tuple(_drive(drive) for drives in worlds.values() for drive in drives),
        worlds=tuple(sorted({a.pair.world for m in measured for a in m.answers})),
        methods={m.method: _method(m) for m in measured},
        groups={group: _by_spacing(measured, protocol, _of_group(group)) for group in named},
        uncertainty={
            group: {m.method: describe_uncertainty(list(filter(_of_group(group), m.answers))) for m in measured}
            for group in named
        },
        maintenance={group: _maintenance(measured, protocol, group) for group in named},
        recorded=recorded,
        searches=rows.searches,
        kinds=rows.kinds,
        maps=maps.maps,
        rows=len(rows.rows),
        alignments={group: _alignments(measured, aligned, protocol, group) for group in named} if aligned else {},
    )


def _drive(drive: Drive) -> DriveRecord:
    roles = ' and '.join(word for word, has in (('mapped', drive.mapped), ('searched', drive.queried)) if has)
    return DriveRecord(
        group=drive.group,
        world=drive.world,
        index=drive.index,
        name=drive.name,
        scans=len(drive),
        path_length_m=float(drive.driven_m[-1] - drive.driven_m[0]),
        roles='validation' if drive.group == VALIDATION else roles,
    )


def _method(measured: Measured) -> MethodRecord:
    info = measured.model
    return MethodRecord(
        encoder=info.name,
        fingerprint=info.fingerprint,
        dimension=info.dimension,
        weights=Path(measured.weights).name,
        settings=dict(info.metadata),
        fitted_to_each_map=measured.fitted,
        thresholds=measured.thresholds,
        cost=measured.cost,
    )


def _of_group(group: str) -> Callable[[Answers], bool]:
    return lambda answers: group in (ALL, answers.pair.group)


def _by_spacing(
    measured: Sequence[Measured], protocol: Protocol, chosen: Callable[[Answers], bool]
) -> dict[str, dict[str, SearchFigures]]:
    return {
        spacing_key(spacing_m): {
            m.method: summarise(
                [a for a in m.answers if chosen(a) and a.pair.spacing_m == spacing_m], protocol, m.thresholds, m.gate
            )
            for m in measured
        }
        for spacing_m in protocol.map_spacings_m
    }


def _maintenance(measured: Sequence[Measured], protocol: Protocol, group: str) -> dict[str, dict[str, AblationFigures]]:
    found: dict[str, dict[str, AblationFigures]] = {}
    for spacing_m in protocol.map_spacings_m:
        by_method = found[spacing_key(spacing_m)] = {}
        for m in measured:
            keys = [key for key in m.ablations if group in (ALL, key[0]) and key[1] == spacing_m]
            several = [ablation for key in keys for ablation in m.ablations[key]]
            if several:
                by_method[m.method] = summarise_ablation(several, m.thresholds.deployed, protocol)
    return found


def _alignments(
    measured: Sequence[Measured], aligned: Mapping[str, Sequence[AlignedPair]], protocol: Protocol, group: str
) -> dict[str, dict[str, AlignmentFigures]]:
    found: dict[str, dict[str, AlignmentFigures]] = {}
    for spacing_m in protocol.map_spacings_m:
        by_method = found[spacing_key(spacing_m)] = {}
        for m in measured:
            several = [
                one.answers
                for one in aligned.get(m.method, ())
                if group in (ALL, one.pair.group) and one.pair.spacing_m == spacing_m
            ]
            if several:
                joined = joined_answers(several)
                by_method[m.method] = alignment_figures(joined, m.gate.coefficients, protocol.tolerance_m)
    return found


def _seeds(protocol: Protocol) -> tuple[int, ...]:
    cities = [seed for group in protocol.groups for seed in group.cities]
    streets = [street.seed for group in protocol.groups for street in group.streets]
    return (*cities, *streets, *protocol.validation.cities, protocol.seed)
