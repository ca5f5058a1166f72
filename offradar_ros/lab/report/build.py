"""A report from an evaluation's folder."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.lab.report.ablation_tables import ablation_tables
from offradar_ros.lab.report.curves import precision_recall_figures, rejection_figures
from offradar_ros.lab.report.other_tables import cost_table, drives_table, recorded_tables
from offradar_ros.lab.report.places import map_figures, trajectory_figures
from offradar_ros.lab.report.recognition_tables import recognition_table
from offradar_ros.lab.report.sections import FigureSection, Report, TableSection
from offradar_ros.lab.report.source import Source
from offradar_ros.lab.report.uncertainty_tables import deployed_tables, threshold_tables, uncertainty_table

PICTURES = {
    'extremes': (
        'Most and least uncertain scans',
        'Ten most (top) and ten least uncertain scans of {method}, to the range of the radar (164 m at most), each '
        'above its ring key: mean power, in recorded bytes, against range; {word}.',
        'Twenty radar scans with their ring keys',
    ),
    'failures': (
        'Failures',
        'Wrong answers that {method} was surest of, whatever the threshold, one for each stretch of road: the query, '
        'the place that it found and how far from the query that is, and the right place nearest to it; {word}.',
        'Radar scans of queries beside the wrong and the right places',
    ),
    'severity': (
        'U against severity',
        'U of every scan of {method} against how badly the simulation degraded it; {word}.',
        'Scatter of U against severity for each kind of degradation',
    ),
}
"""What evaluations draw of scans, which are not in their folder: title, caption, what they show."""


def build_report(source: Source) -> Report:
    """Every table and figure; those of scans where the evaluation drew pictures."""
    results = source.results
    versions = ', '.join(f'{name} {version}' for name, version in results.versions.items())
    figures = [
        *rejection_figures(source),
        *precision_recall_figures(source),
        *map_figures(source),
        *trajectory_figures(source),
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
    """What was driven, then those of the paper's form."""
    yield drives_table(source)
    places = [(group, spacing) for group in source.groups for spacing in source.spacings]
    for group, spacing in places:
        yield recognition_table(source, group, spacing)
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
        yield 'Everything here is simulated: no figure is of a recorded scan unless its caption says so.'
    for group in protocol.groups:
        worlds = dict.fromkeys(drive.world for drive in results.drives if drive.group == group.name)
        yield f'{group.title}: {", ".join(worlds) or "nothing"}; {group.scans}.'
        splits = dict.fromkeys(road.split for road in group.recorded if results.splits.get(road.split))
        yield from (f'Split {split}: {results.splits[split]}' for split in splits)
    yield (
        f'A place within {protocol.tolerance_m:g} m of the query is right; pairs farther apart than '
        f'{protocol.negative_m:g} m are wrong ones. Maps are maintained with D_t = '
        f'{protocol.maintenance.match_distance_m:g} m.'
    )
    for name in source.methods:
        method = results.methods[name]
        weights = f' weights {method.weights},' if method.weights else ''
        encoder = '' if method.encoder == name else f' {method.encoder},'
        yield f'{name}:{encoder}{weights} fingerprint {method.fingerprint[:12]}.'
    yield from (f'Note: {text}.' for text in results.skipped)


def _pictures(source: Source) -> Iterator[FigureSection]:
    word = source.results.scans(source.groups[-1])
    for name, (title, caption, alternative) in PICTURES.items():
        path = source.folder / f'{name}_{source.shown}.png'
        if path.is_file():
            text = caption.format(method=source.shown, word=word)
            yield FigureSection(name, title, text, alternative, path.read_bytes())
