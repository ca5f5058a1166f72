"""Results as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from rich.table import Table

from offradar_ros.lab.evaluation.confidences import CONFIDENCES
from offradar_ros.lab.evaluation.open_set_summary import PRECISIONS
from offradar_ros.lab.evaluation.protocol import ALL
from offradar_ros.lab.evaluation.results.ablation import CASES, AblationFigures
from offradar_ros.lab.evaluation.results.alignments import AlignmentFigures, PoseFigures
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.results.results import ByMap, FiguresT, Results
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.results.uncertainty import RecordedUncertainty


def tables(results: Results) -> Iterator[Table]:
    """One table for each group and map spacing, one of the ablation of the system, of alignments, of recorded scans.

    Where a part of each map is left out, there is also a table of confidences for each group and map spacing.
    """
    for group, spacings in reported_groups(results.groups).items():
        for spacing, methods in spacings.items():
            words = f'a map every {spacing} m' if float(spacing) else 'every scan mapped'
            yield _methods_table(f'{results.title(group)}: {words}', methods)
            if results.protocol.leaves_out:
                yield _confidence_table(f'{results.title(group)}, {words}: wrong or off the map', methods)
    maintenance = reported_groups(results.maintenance)
    if any(methods for spacings in maintenance.values() for methods in spacings.values()):
        yield _maintenance_table(maintenance)
    aligned = reported_groups(results.alignments)
    if any(methods for spacings in aligned.values() for methods in spacings.values()):
        yield _alignments_table(aligned)
    if results.recorded:
        yield _recorded_table(results.recorded)


def reported_groups(groups: ByMap[FiguresT]) -> ByMap[FiguresT]:
    """The figures without those of all groups together if there is only one group."""
    return groups if len(groups) > 2 else {name: figures for name, figures in groups.items() if name != ALL}


def number(value: float) -> str:
    """Three decimals; a dash for NaN."""
    return '-' if math.isnan(value) else f'{value:.3f}'


def with_interval(figure: Interval) -> str:
    """A figure and its 95 % interval, if it has one."""
    if math.isnan(figure.low):
        return number(figure.value)
    return f'{number(figure.value)} ({number(figure.low)} to {number(figure.high)})'


def _methods_table(title: str, methods: dict[str, SearchFigures]) -> Table:
    table = Table('', *methods, title=title)
    rows: dict[str, Callable[[SearchFigures], str]] = {
        'Recall@1': lambda f: with_interval(f.recall_at_1),
        'of clean scans': lambda f: with_interval(f.recall_at_1_clean),
        'of degraded scans': lambda f: with_interval(f.recall_at_1_degraded),
        'Recall@5, @10': lambda f: f'{number(f.recall_at_5.value)}, {number(f.recall_at_10.value)}',
        'AUROC of U for wrong answers': lambda f: with_interval(f.auroc_wrong),
        'AUROC of the true severity': lambda f: number(f.auroc_wrong_by_severity),
        'AUROC of the other maps': lambda f: number(f.auroc_wrong_by_other_maps),
        'Recall@RR .1 .2 .3 .4 .5': lambda f: ' '.join(number(r) for _, r in f.recall_at_rejection[1:6]),
        'area under Recall@RR': lambda f: with_interval(f.auc_recall_at_rejection),
        'threshold, rejected, precision': _deployed,
        'queries on the map, off it; places per map': lambda f: (
            f'{f.with_positive}, {f.queries - f.with_positive}; {f.places:.0f}'
        ),
        'gate: answered on the map, off it': _answered,
        'wrong, of its answers': lambda f: number(f.open_set.gate.wrong),
        'AUROC of p_right for wrong or off the map': _auroc_of_p_right,
    }
    for name, cell in rows.items():
        cells = [cell(figures) for figures in methods.values()]
        # The severity of recorded scans is unknown: rows without any value are left out.
        if any(set(text) - set('-, ') for text in cells):
            table.add_row(name, *cells)
    return table


def _answered(figures: SearchFigures) -> str:
    gate = figures.open_set.gate
    return f'{number(gate.answered_on_map)}, {number(gate.answered_off_map)}'


def _auroc_of_p_right(figures: SearchFigures) -> str:
    found = figures.open_set.confidences.get('p_right')
    return with_interval(found.auroc) if found else '-'


def _confidence_table(title: str, methods: dict[str, SearchFigures]) -> Table:
    wanted = ' '.join(f'{precision:g}' for precision in PRECISIONS)
    table = Table(
        '', 'confidence', 'AUROC', 'AUPR', f'right answers kept at precision {wanted}', 'off the map', title=title
    )
    for method, figures in methods.items():
        for name, found in figures.open_set.confidences.items():
            kept = ' '.join(number(at.right_kept) for at in found.at_precision)
            off = ' '.join(number(at.off_map_answered) for at in found.at_precision)
            cells = (with_interval(found.auroc), number(found.average_precision), kept, off)
            table.add_row(method, CONFIDENCES[name], *cells)
    return table


def _deployed(figures: SearchFigures) -> str:
    found = figures.at_deployed_threshold
    if found is None:
        return '-'
    return f'{number(found.threshold)}, {number(found.rejected_of_every_query)}, {number(found.precision)}'


def _maintenance_table(maintenance: ByMap[AblationFigures]) -> Table:
    table = Table('', 'map every', 'method', *CASES, 'rejected', title='Maintained maps and introspective queries')
    for group, spacings in maintenance.items():
        for spacing, methods in spacings.items():
            for method, figures in methods.items():
                cells = [number(figures.recall_at_1[case]) for case in CASES]
                table.add_row(group, f'{spacing} m', method, *cells, number(figures.rejected))
    return table


def _alignments_table(aligned: ByMap[AlignmentFigures]) -> Table:
    every = [figures for spacings in aligned.values() for methods in spacings.values() for figures in methods.values()]
    ways = list(dict.fromkeys(way for figures in every for way in figures.by_way))
    table = Table(
        '',
        'map every',
        'method',
        'Recall@1 by distance, aligned',
        *ways,
        title='Alignments: pairs within 10 m, share within 2 m and 2°, median error',
    )
    for group, spacings in aligned.items():
        for spacing, methods in spacings.items():
            for method, figures in methods.items():
                found = figures.answers
                recalls = (
                    f'{number(found.recall_at_1_by_distance)}, {number(found.recall_at_1_aligned)}' if found else '-'
                )
                table.add_row(group, f'{spacing} m', method, recalls, *(_pose(figures.by_way.get(way)) for way in ways))
    return table


def _pose(found: PoseFigures | None) -> str:
    return f'{found.pairs}, {number(found.right)}, {found.median_m:.2f} m {found.median_deg:.2f}°' if found else '-'


def _recorded_table(recorded: RecordedUncertainty) -> Table:
    conditions = next(iter(recorded.methods.values()))
    table = Table('', *conditions, title='U of recorded scans: mean, and the share above every clean scan')
    for method, by_condition in recorded.methods.items():
        cells = (f'{number(found.mean)}, {found.above_every_clean:.0%}' for found in by_condition.values())
        table.add_row(method, *cells)
    return table
