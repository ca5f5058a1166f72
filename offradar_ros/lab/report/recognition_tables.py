"""Recognition in the form of the paper's Tab. 1 and 2, next to the figures of the paper."""

from __future__ import annotations

import math
from collections.abc import Sequence

from offradar_ros.lab.evaluation.methods import OURS
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.results.recognition import Recognition
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.table import number
from offradar_ros.lab.report.labels import METHOD_NAMES, percent, spacing_label
from offradar_ros.lab.report.paper_tables import PAPER_TABLES, PAPER_TITLES, PaperRow
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source

RECOGNITION_HEAD = (
    'method',
    'R@1 (%)',
    'R@5 (%)',
    'R@10 (%)',
    'R@1, 95 %',
    'F1',
    'F0.5',
    'F2',
    'AP',
    'R@1 of all (%)',
    'AP of pairs',
)
PAPER_HEAD = ('R@1/5/10', 'F (as printed)', 'AP')


def recognition_table(source: Source, group: str, spacing: str) -> TableSection:
    """Recall@1, 5, 10, F_β and AP, with a row OURS(M) if maps were maintained, next to the figures of the paper."""
    methods = source.results.groups[group][spacing]
    rows: dict[str, Recognition] = {name: methods[name] for name in source.methods}
    ablation = source.results.maintenance.get(group, {}).get(spacing, {}).get(OURS)
    if ablation:
        rows[f'{OURS} (M)'] = ablation.maintained
    which = _paper_table_of(source, group)
    paper = PAPER_TABLES.get(which, {})
    columns = [_recognition(figures) for figures in rows.values()]
    ranks = [_ranks([column[k] for column in columns]) for k in range(len(columns[0]))]
    cells = [
        (METHOD_NAMES.get(name, name), *own, *(_paper_cells(paper.get(name)) if paper else ()))
        for (name, _), own in zip(rows.items(), columns, strict=True)
    ]
    first = next(iter(methods.values()))
    scans = source.results.scans(group)
    paper_note = f' Right columns: {PAPER_TITLES[which]}, F as printed there' if paper else ''
    if paper and scans != 'recorded scans':
        paper_note += '; they are of recorded scans and of the networks of the paper'
    return TableSection(
        f'recognition_{group}_{spacing}m',
        f'Recognition: {source.results.title(group)}, {spacing_label(spacing)}',
        f'Over {first.with_positive} of {first.queries} queries, those with a positive in the map, of {first.pairs} '
        f'ordered pairs of drives, with a 95 % bootstrap interval over pairs; {scans}. F is the highest over '
        'thresholds on the distance of the nearest place, for each β separately; AP is over the same thresholds, one '
        'answer per query. R@1 of all counts every query: one without a positive is always wrong. AP of pairs is of '
        f'every query with every place.{paper_note}{"." if paper_note else ""}',
        RECOGNITION_HEAD + (tuple(f'paper: {name}' for name in PAPER_HEAD) if paper else ()),
        tuple(cells),
        *(_cells_of_rank(ranks, rank) for rank in (0, 1)),
    )


def _paper_table_of(source: Source, group: str) -> int:
    return next((known.paper for known in source.results.protocol.groups if known.name == group), 0)


def _paper_cells(row: PaperRow | None) -> tuple[str, ...]:
    if row is None:
        return ('-',) * len(PAPER_HEAD)
    printed = ' / '.join(f'{value:.2f}' for value in row.f_printed)
    recalls = ' / '.join(f'{value:.2f}' for value in (row.recall_at_1, row.recall_at_5, row.recall_at_10))
    return recalls, printed, f'{row.average_precision:.2f}'


def _recognition(figures: Recognition) -> list[str]:
    recalls = [figures.recall_at_1, figures.recall_at_5, figures.recall_at_10]
    f_beta = [figures.max_f_beta[beta].value for beta in ('1', '0.5', '2')]
    pairs = figures.pair_level.average_precision.value if isinstance(figures, SearchFigures) else math.nan
    return [
        *(percent(recall.value) for recall in recalls),
        _interval(figures.recall_at_1),
        *map(number, [*f_beta, figures.average_precision.value]),
        percent(figures.every_query.recall_at_1),
        number(pairs),
    ]


def _interval(figure: Interval) -> str:
    ends = [percent(end) for end in (figure.low, figure.high)]
    return '-' if '-' in ends else ' to '.join(ends)


def _cells_of_rank(ranks: Sequence[Sequence[int]], rank: int) -> frozenset[tuple[int, int]]:
    """(row, column) of the cells of this rank; none in a table of one row."""
    cells = [(row, k + 1, at) for k, column in enumerate(ranks) for row, at in enumerate(column) if len(column) > 1]
    return frozenset((row, k) for row, k, at in cells if at == rank)


def _ranks(column: Sequence[str]) -> list[int]:
    """Ranks of the cells of a column, 0 for the highest; equal values share a rank, a cell without a number has −1."""
    if any(' to ' in text for text in column):
        return [-1] * len(column)
    known = sorted({float(text) for text in column if text != '-'}, reverse=True)
    return [known.index(float(text)) if text != '-' else -1 for text in column]
