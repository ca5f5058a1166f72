"""The ablation of map maintenance and introspective querying."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.lab.evaluation.results.ablation import CASES, AblationFigures
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.table import number
from offradar_ros.lab.report.labels import method_label, percent, spacing_label
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source

CAPTION = (
    'Recall@1 in %. O: the map of one drive; M: the same map after all other mapped drives, but not the query drive, '
    'were merged into it; M_random: as many replacements, drawn at random; Q, QM: O and M over the queries whose U is '
    'at most the threshold. Replacements: merged scans that replaced a place, of those with a place within D_t. Gains '
    'in percentage points, with 95 % bootstrap intervals over pairs.'
)
HEAD = ('method', *CASES, 'M over O', 'M over M_random', 'rejected (%)', 'threshold', 'replacements')


def ablation_tables(source: Source) -> Iterator[TableSection]:
    """O, M, M_random, Q and QM of every method whose map was maintained."""
    for group in source.groups:
        for spacing, methods in source.results.maintenance.get(group, {}).items():
            if methods:
                yield TableSection(
                    f'ablation_{group}_{spacing}m',
                    f'Ablation: {source.results.title(group)}, {spacing_label(spacing)}',
                    f'{CAPTION} {source.results.scans(group).capitalize()}.',
                    HEAD,
                    tuple(_row(method, methods[method]) for method in source.methods if method in methods),
                )


def _row(method: str, figures: AblationFigures) -> tuple[str, ...]:
    return (
        method_label(method),
        *(percent(figures.recall_at_1[case]) for case in CASES),
        _points(figures.gain_over_unmaintained),
        _points(figures.gain_over_random),
        percent(figures.rejected),
        number(figures.threshold),
        f'{figures.replaced} of {figures.opportunities}',
    )


def _points(gain: Interval) -> str:
    texts = [percent(value) for value in (gain.value, gain.low, gain.high)]
    return texts[0] if '-' in texts else f'{texts[0]} ({texts[1]} to {texts[2]})'
