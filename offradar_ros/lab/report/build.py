"""A report from the folder of an evaluation."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.report.ablation_tables import ablation_tables
from offradar_ros.lab.report.alignment_tables import alignment_tables
from offradar_ros.lab.report.cost_table import cost_table
from offradar_ros.lab.report.curves import precision_recall_figures, rejection_figures
from offradar_ros.lab.report.drives_table import drives_table
from offradar_ros.lab.report.open_set_curves import open_set_figures
from offradar_ros.lab.report.open_set_tables import open_set_tables
from offradar_ros.lab.report.outcomes import outcome_figures
from offradar_ros.lab.report.places import map_figures
from offradar_ros.lab.report.recognition_tables import recognition_table
from offradar_ros.lab.report.sections import FigureSection, Report, TableSection
from offradar_ros.lab.report.source import Source
from offradar_ros.lab.report.uncertainty_tables import (
    deployed_tables,
    recorded_tables,
    threshold_tables,
    uncertainty_table,
)

PICTURES = {
    'extremes': (
        'Most and least uncertain scans',
        'Ten most (top) and ten least uncertain scans of {method}, to the range of the radar (164 m at most), each '
        'above its ring key: mean power, in recorded bytes, against range; {scans}.',
        'Twenty radar scans with their ring keys',
    ),
    'failures': (
        'Wrong answers',
        'The wrong answers of {method} with the lowest U, whatever the threshold, at most one within 50 m: the query, '
        'the place found with its distance from the query, and the place nearest to the query; {scans}.',
        'Radar scans of queries, of the places found and of the nearest places',
    ),
    'alignments': (
        'Alignments',
        'Ten alignments of {method}, from the smallest error of the position (0%) to the largest (100%), at even steps '
        'in the order of errors, in the maps of the first density. In the frame of the vehicle at the '
        'place, which looks up: the scan of the place (magenta), and that of the query as aligned with it (green); '
        'white where both have returns. Arrows start at a vehicle: at the place, as aligned, and in truth (yellow, '
        'wide: the green one lies on it where the alignment is right). Titles: error of the pose, score, distance of '
        'the place on the ground, and the faults of query and place where they have any; {scans}.',
        'Pairs of radar scans in two colours, one laid over the other',
    ),
    'severity': (
        'U against severity',
        'U of every scan of {method} against the severity of its degradation; {scans}.',
        'Scatter of U against severity for each kind of degradation',
    ),
}
"""Pictures that the evaluation draws, because its folder does not hold scans: title, caption, alternative text."""


def build_report(source: Source) -> Report:
    """Every table and figure; pictures of scans if the evaluation drew them."""
    results = source.results
    versions = ', '.join(f'{name} {version}' for name, version in results.versions.items())
    figures = [
        *rejection_figures(source),
        *precision_recall_figures(source),
        *open_set_figures(source),
        *map_figures(source),
        *outcome_figures(source),
        *_pictures(source),
    ]
    return Report(
        title=results.protocol.title,
        remarks=tuple(_remarks(source)),
        tables=tuple(_tables(source)),
        figures=tuple(figures),
        command=results.command,
        versions=f'{results.created}: {versions}',
    )


def _tables(source: Source) -> Iterator[TableSection]:
    """The drives, then recognition, queries on and off the map, alignments, ablation, uncertainty and cost."""
    yield drives_table(source)
    places = [(group, spacing) for group in source.groups for spacing in source.spacings]
    for group, spacing in places:
        yield recognition_table(source, group, spacing)
        yield from open_set_tables(source, group, spacing)
        yield from alignment_tables(source, group, spacing)
    yield from ablation_tables(source)
    for group, spacing in places:
        yield uncertainty_table(source, group, spacing)
        yield from deployed_tables(source, group, spacing)
        yield from threshold_tables(source, group, spacing)
    yield cost_table(source)
    yield from recorded_tables(source)


def _remarks(source: Source) -> Iterator[str]:
    results, protocol = source.results, source.results.protocol
    if {results.scans(group) for group in source.groups} == {'simulated scans'}:
        yield 'All scans are simulated, unless a caption says otherwise.'
    for group in protocol.groups:
        worlds = dict.fromkeys(drive.world for drive in results.drives if drive.group == group.name)
        yield f'{group.title}: {", ".join(worlds) or "not measured"}; {group.scans}.'
        splits = dict.fromkeys(road.split for road in group.recorded if results.splits.get(road.split))
        yield from (f'Split {split}: {results.splits[split]}' for split in splits)
    maps = f'Maps are maintained with D_t = {protocol.maintenance.match_distance_m:g} m.'
    if protocol.leaves_out:
        maps = f'Two maps are made of each drive: {_left_out(protocol)}; they are not maintained.'
    yield (
        f'A place within {protocol.tolerance_m:g} m of the query is a positive, one beyond {protocol.negative_m:g} m a '
        f'negative. {maps}'
    )
    for name in source.methods:
        method = results.methods[name]
        weights = f' weights {method.weights},' if method.weights else ''
        encoder = '' if method.encoder == name else f' {method.encoder},'
        yield f'{name}:{encoder}{weights} fingerprint {method.fingerprint[:12]}.'
    yield from (f'Note: {text}.' for text in results.skipped)


def _left_out(protocol: Protocol) -> str:
    if protocol.leave_out:
        return 'of either, the other half of the road is left out'
    return f'stretches of {protocol.leave_out_m:g} m of the road are mapped and left out by turns'


def _pictures(source: Source) -> Iterator[FigureSection]:
    scans = source.results.scans(source.groups[-1])
    for name, (title, caption, alternative) in PICTURES.items():
        path = source.folder / f'{name}_{source.main_method}.png'
        if path.is_file():
            text = caption.format(method=source.main_method, scans=scans)
            yield FigureSection(name, title, text, alternative, path.read_bytes())
