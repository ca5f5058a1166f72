"""Figures of U: ranking, the threshold in use, static thresholds, and U of recorded scans."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.table import number, with_interval
from offradar_ros.lab.report.labels import method_label, percent, spacing_label
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source


def uncertainty_table(source: Source, group: str, spacing: str) -> TableSection:
    """U as a ranking of the queries."""
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
        f'Uncertainty: {source.results.title(group)}, {spacing_label(spacing)}',
        'AUROC: probability that a wrong answer has a higher U than a correct one. RR 0 to 0.9: Recall@RR, Recall@1 '
        '(%) of the rest when this share is rejected, the most uncertain first. AUSC, AUSE, ECE: lower is better. With '
        f'95 % bootstrap intervals over pairs of drives; {source.results.scans(group)}.',
        ('method', *cells, *(f'RR {share:g}' for share in shares)),
        tuple(
            (
                method_label(name),
                *(cell(methods[name]) for cell in cells.values()),
                *(percent(recall) for _, recall in methods[name].recall_at_rejection),
            )
            for name in source.methods
        ),
    )


def deployed_tables(source: Source, group: str, spacing: str) -> Iterator[TableSection]:
    """Figures at the threshold in use, if there is one."""
    rows = []
    for name in source.methods:
        found = source.results.groups[group][spacing][name].at_deployed_threshold
        if found:
            f_beta = (number(found.f_beta[beta]) for beta in ('1', '0.5', '2'))
            shares = (found.rejected, found.recall_at_1, found.precision)
            rows.append((method_label(name), number(found.threshold), *map(percent, shares), *f_beta))
    if rows:
        yield TableSection(
            f'deployed_{group}_{spacing}m',
            f'The threshold in use: {source.results.title(group)}, {spacing_label(spacing)}',
            'Rejected: share of the queries with a positive (%). Recall@1 of those that are answered (%). '
            'Precision (%) and F count every query: an answer to a query without a positive is wrong, a rejected query '
            f'with a positive is missed; {source.results.scans(group)}.',
            ('method', 'threshold', 'rejected (%)', 'R@1 of the answered (%)', 'precision (%)', 'F1', 'F0.5', 'F2'),
            tuple(rows),
        )


def threshold_tables(source: Source, group: str, spacing: str) -> Iterator[TableSection]:
    """Recall@1 of the queries that each static threshold accepts, of the main method."""
    found = source.results.groups[group][spacing][source.main_method].recall_at_threshold
    # Of the thresholds that accept no query, the highest is enough.
    found = found[max(0, sum(row.kept == 0 for row in found) - 1) :]
    if found:
        yield TableSection(
            f'thresholds_{group}_{spacing}m',
            f'Static thresholds of {method_label(source.main_method)}: {source.results.title(group)}, '
            f'{spacing_label(spacing)}',
            'T = (1 − Δ) + n · 2Δ/N, Δ the largest |U − 1| of the validation drives. Thresholds below the first accept '
            f'no query; {source.results.scans(group)}.',
            ('T', 'rejected (%)', 'kept', 'R@1 (%)'),
            tuple(
                (number(row.threshold), percent(row.rejected), str(row.kept), percent(row.recall_at_1)) for row in found
            ),
        )


def recorded_tables(source: Source) -> Iterator[TableSection]:
    """U of recorded scans, clean and degraded, if it was measured."""
    recorded = source.results.recorded
    if not recorded:
        return
    conditions = list(next(iter(recorded.methods.values())))
    rows = tuple(
        (method_label(name), *(number(recorded.methods[name][condition].mean) for condition in conditions))
        for name in source.methods
    )
    others = ''.join(f'; {condition}: {name}' for condition, name in recorded.compared.items())
    yield TableSection(
        'recorded_scans',
        'U of recorded scans',
        f'Mean U of the recorded scans of {recorded.clean}, as recorded and with faults added to their bytes{others}.',
        ('method', *conditions),
        rows,
    )
