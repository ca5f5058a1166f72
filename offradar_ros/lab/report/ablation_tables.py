"""Maintained maps and introspective queries, by themselves and together."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.lab.evaluation.summary import Json
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
GAINS = {'M_over_O': 'M over O', 'M_over_M_random': 'M over M_random'}


def ablation_tables(source: Source) -> Iterator[TableSection]:
    """O, M, M_random, Q and QM of every method that has them."""
    names = ('O', 'M', 'M_random', 'Q', 'QM')
    for group in source.groups:
        for spacing, methods in source.results['maintenance'].get(group, {}).items():
            if methods:
                rows = tuple(
                    (
                        name_of(method),
                        *(percent(methods[method][name]) for name in names),
                        *(_points(methods[method]['gains'][gain]) for gain in GAINS),
                        percent(methods[method]['rejected']),
                        number(methods[method]['threshold']),
                        f'{methods[method]["replaced"]} of {methods[method]["opportunities"]}',
                    )
                    for method in source.methods
                    if method in methods
                )
                yield TableSection(
                    f'ablation_{group}_{spacing}m',
                    f'Ablation: {source.title(group)}, {map_words(spacing)}',
                    f'{CAPTION} {source.data_word(group).capitalize()}.',
                    ('method', *names, *GAINS.values(), 'rejected (%)', 'threshold', 'replacements'),
                    rows,
                )


def _points(gain: Json) -> str:
    told = [percent(gain[name]) for name in ('value', 'low', 'high')]
    return told[0] if '-' in told else f'{told[0]} ({told[1]} to {told[2]})'
