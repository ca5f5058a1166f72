"""What U is worth: rankings, the threshold in use, and static thresholds."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.table import number, with_interval
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source
from offradar_ros.lab.report.words import map_words, name_of, percent


def uncertainty_table(source: Source, group: str, spacing: str) -> TableSection:
    """What U is worth."""
    methods = source.results.groups[group][spacing]
    shares = [share for share, _ in next(iter(methods.values())).recall_at_rejection]
    cells: dict[str, Callable[[SearchFigures], str]] = {
        'AUROC of U': lambda f: with_interval(f.auroc_wrong),
        'area under Recall@RR': lambda f: with_interval(f.auc_recall_at_rejection),
        'AUSC': lambda f: with_interval(f.ausc),
        'AUSE': lambda f: number(f.ause),
        'ECE': lambda f: number(f.ece),
    }
    return TableSection(
        f'uncertainty_{group}_{spacing}m',
        f'Uncertainty: {source.results.title(group)}, {map_words(spacing)}',
        'AUROC: chance that a wrong answer has the higher U. RR 0 to 0.9: Recall@RR, Recall@1 (%) of what is left when '
        'this share is rejected, the most uncertain first. AUSC, AUSE, ECE: lower is better. With '
        f'95 % bootstrap intervals over pairs of drives; {source.results.scans(group)}.',
        ('method', *cells, *(f'RR {share:g}' for share in shares)),
        tuple(
            (
                name_of(name),
                *(cell(methods[name]) for cell in cells.values()),
                *(percent(recall) for _, recall in methods[name].recall_at_rejection),
            )
            for name in source.methods
        ),
    )


def deployed_tables(source: Source, group: str, spacing: str) -> Iterator[TableSection]:
    """What the one threshold in use does, where there is one."""
    rows = []
    for name in source.methods:
        found = source.results.groups[group][spacing][name].at_deployed_threshold
        if found:
            f_beta = (number(found.f_beta[beta]) for beta in ('1', '0.5', '2'))
            shares = (found.rejected, found.recall_at_1, found.precision)
            rows.append((name_of(name), number(found.threshold), *map(percent, shares), *f_beta))
    if rows:
        yield TableSection(
            f'deployed_{group}_{spacing}m',
            f'The threshold in use: {source.results.title(group)}, {map_words(spacing)}',
            'Rejected: share of the queries that have a right place (%). Recall@1 of those that are answered (%). '
            'Precision (%) and F count every query: an answer where no place is right is wrong, a rejected query that '
            f'has a right place is missed; {source.results.scans(group)}.',
            ('method', 'threshold', 'rejected (%)', 'R@1 of the answered (%)', 'precision (%)', 'F1', 'F0.5', 'F2'),
            tuple(rows),
        )


def threshold_tables(source: Source, group: str, spacing: str) -> Iterator[TableSection]:
    """Recall@1 of what each static threshold keeps, of the method that is shown."""
    found = source.results.groups[group][spacing][source.shown].recall_at_threshold
    # Of those that keep nothing the highest is enough.
    found = found[max(0, sum(row.kept == 0 for row in found) - 1) :]
    if found:
        yield TableSection(
            f'thresholds_{group}_{spacing}m',
            f'Static thresholds of {name_of(source.shown)}: {source.results.title(group)}, {map_words(spacing)}',
            'T = (1 − Δ) + n · 2Δ/N, Δ the largest |U − 1| of the validation drives. Lower ones than the first keep '
            f'nothing, and have no recall; {source.results.scans(group)}.',
            ('T', 'rejected (%)', 'kept', 'R@1 (%)'),
            tuple(
                (number(row.threshold), percent(row.rejected), str(row.kept), percent(row.recall_at_1)) for row in found
            ),
        )
