"""Maintained maps and introspective queries, by themselves and together."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.lab.evaluation.results.ablation import CASES, AblationFigures
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.table import number
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source
from offradar_ros.lab.report.words import map_words, name_of, percent

CAPTION = (
    'Recall@1 in %. O: the map of one drive; M: every other drive of which maps are made, but never the query, is '
    'merged into it; M_random: as many replacements, drawn at random; Q, QM: the same of the queries whose U is at '
    'most the threshold. Replacements: merged scans that took a place over, of those that had one within D_t. Gains in '
    'points, with 95 % bootstrap intervals over pairs.'
)
HEAD = ('method', *CASES, 'M over O', 'M over M_random', 'rejected (%)', 'threshold', 'replacements')


def ablation_tables(source: Source) -> Iterator[TableSection]:
    """O, M, M_random, Q and QM of every method that has them."""
    for group in source.groups:
        for spacing, methods in source.results.maintenance.get(group, {}).items():
            if methods:
                yield TableSection(
                    f'ablation_{group}_{spacing}m',
                    f'Ablation: {source.results.title(group)}, {map_words(spacing)}',
                    f'{CAPTION} {source.results.scans(group).capitalize()}.',
                    HEAD,
                    tuple(_row(method, methods[method]) for method in source.methods if method in methods),
                )


def _row(method: str, figures: AblationFigures) -> tuple[str, ...]:
    return (
        name_of(method),
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
