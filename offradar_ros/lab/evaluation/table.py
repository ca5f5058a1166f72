"""Results as tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from rich.table import Table

from offradar_ros.lab.evaluation.protocol import ALL
from offradar_ros.lab.evaluation.summary import Json


def tables(results: Json) -> Iterator[Table]:
    """One table for each group and map spacing, one of the ablation of the system, and one of the targets."""
    titles = {group['name']: group['title'] for group in results['protocol']['groups']} | {'all': 'All groups'}
    for group, spacings in told_apart(results['groups']).items():
        for spacing, methods in spacings.items():
            words = f'a map every {spacing} m' if float(spacing) else 'every scan mapped'
            yield _methods_table(f'{titles[group]}: {words}', methods)
    maintenance = told_apart(results['maintenance'])
    if any(methods for spacings in maintenance.values() for methods in spacings.values()):
        yield _maintenance_table(maintenance)
    if results.get('recorded'):
        yield _recorded_table(results['recorded'])
    if results.get('targets'):
        yield _targets_table(results['targets'])


def told_apart(groups: Json) -> Json:
    """Without the figures of all groups together where there is but one."""
    return groups if len(groups) > 2 else {name: told for name, told in groups.items() if name != ALL}


def number(value: float | None) -> str:
    """Three decimals, a dash for what could not be measured."""
    return '-' if value is None or math.isnan(value) else f'{value:.3f}'


def with_interval(figure: Json) -> str:
    """A figure and its 95 % interval, where it has one."""
    if figure['low'] is None or math.isnan(figure['low']):
        return number(figure['value'])
    return f'{number(figure["value"])} ({number(figure["low"])} to {number(figure["high"])})'


def _methods_table(title: str, methods: Json) -> Table:
    table = Table('', *methods, title=title)
    rows: dict[str, Callable[[Json], str]] = {
        'Recall@1': lambda f: with_interval(f['recall_at_1']),
        'of clean scans': lambda f: with_interval(f['recall_at_1_clean']),
        'of degraded scans': lambda f: with_interval(f['recall_at_1_degraded']),
        'Recall@5, @10': lambda f: ', '.join(number(f[f'recall_at_{n}']['value']) for n in (5, 10)),
        'AUROC of U for wrong answers': lambda f: with_interval(f['auroc_wrong']),
        'AUROC of the true severity': lambda f: number(f['auroc_wrong_by_severity']),
        'AUROC of the other maps': lambda f: number(f['auroc_wrong_by_other_maps']),
        'Recall@RR .1 .2 .3 .4 .5': lambda f: ' '.join(number(r) for share, r in f['recall_at_rejection'][1:6]),
        'area under Recall@RR': lambda f: with_interval(f['auc_recall_at_rejection']),
        'threshold, rejected, precision': _deployed,
        'queries with a place, places a map': lambda f: f'{f["with_positive"]} of {f["queries"]}, {f["places"]:.0f}',
    }
    for name, cell in rows.items():
        cells = [cell(figures) for figures in methods.values()]
        # Of recorded scans nobody knows how degraded they are.
        if any(set(text) - set('-, ') for text in cells):
            table.add_row(name, *cells)
    return table


def _deployed(figures: Json) -> str:
    told = figures['at_deployed_threshold']
    if told.get('threshold') is None or math.isnan(told['threshold']):
        return '-'
    return f'{number(told["threshold"])}, {number(told["rejected_of_every_query"])}, {number(told["precision"])}'


def _maintenance_table(maintenance: Json) -> Table:
    names = ('O', 'M', 'M_random', 'Q', 'QM')
    table = Table('', 'map every', 'method', *names, 'rejected', title='Maintained maps and introspective queries')
    for group, spacings in maintenance.items():
        for spacing, methods in spacings.items():
            for method, told in methods.items():
                cells = [number(told[name]) for name in (*names, 'rejected')]
                table.add_row(group, f'{spacing} m', method, *cells)
    return table


def _recorded_table(recorded: Json) -> Table:
    first = next(iter(recorded.values()))
    table = Table('', *first, title='U of recorded scans: mean, and the share above every clean scan')
    for method, told in recorded.items():
        cells = (f'{number(figures["mean"])}, {figures["above_every_clean"]:.0%}' for figures in told.values())
        table.add_row(method, *cells)
    return table


def _targets_table(targets: list[Json]) -> Table:
    """One row for each target, with the place where it is missed most or reached by least."""
    table = Table('', 'target', 'reached', 'closest or worst', 'wanted', 'found', title='Targets')
    texts = dict.fromkeys((target['target'], target['text']) for target in targets)
    for key in texts:
        alike = [target for target in targets if (target['target'], target['text']) == key]
        reached = sum(target['passed'] for target in alike)
        worst = min(alike, key=lambda target: target['found'] - float(target['wanted'][2:]))
        where = f'{worst["group"]}{worst["spacing_m"] and ", " + worst["spacing_m"] + " m"}'
        colour = 'green' if reached == len(alike) else 'red'
        told = f'[{colour}]{reached} of {len(alike)}[/]'
        table.add_row(str(key[0]), key[1], told, where, worst['wanted'], number(worst['found']))
    return table
