"""What was driven, what methods cost, and U of recorded scans."""

from __future__ import annotations

import math
from collections.abc import Iterator

from offradar_ros.lab.evaluation.table import number
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source
from offradar_ros.lab.report.words import name_of


def drives_table(source: Source) -> TableSection:
    """What was driven, and how often it counts."""
    return TableSection(
        'drives',
        'What was driven',
        'A scan counts as often as there are maps in which it is searched. Scans that are left out, for their spacing, '
        'their region or because they have no position, are not counted here.',
        ('drive', 'road', 'scans', 'path length (m)', 'role'),
        tuple(
            (drive.name, drive.world, str(drive.scans), f'{drive.path_length_m:.0f}', drive.roles)
            for drive in source.results.drives
        ),
    )


def cost_table(source: Source) -> TableSection:
    """Time and memory of every method."""
    machine, methods = source.results.machine, source.results.methods
    rows = []
    for name in source.methods:
        cost = methods[name].cost
        numbers = (cost.encode_ms, cost.search_ms, cost.bytes_per_place / 1000.0)
        texts = ('-' if math.isnan(value) else f'{value:.3g}' for value in numbers)
        rows.append((name_of(name), str(methods[name].dimension), *texts))
    return TableSection(
        'cost',
        'Cost',
        f'Medians on {machine.processor}, {machine.cores} cores: encoding one scan from its polar image, finding '
        'ten places in a map of the mean size; memory of a descriptor. The evaluation took '
        f'{max(method.cost.peak_memory_mb for method in methods.values()):.0f} MB of memory at most.',
        ('method', 'dimension', 'encode (ms)', 'search (ms)', 'a place (kB)'),
        tuple(rows),
    )


def recorded_tables(source: Source) -> Iterator[TableSection]:
    """U of recorded scans, clean and degraded, where it was measured."""
    recorded = source.results.recorded
    if not recorded:
        return
    conditions = list(next(iter(recorded.methods.values())))
    rows = tuple(
        (name_of(name), *(number(recorded.methods[name][condition].mean) for condition in conditions))
        for name in source.methods
    )
    others = ''.join(f'; {condition}: {name}' for condition, name in recorded.compared.items())
    yield TableSection(
        'recorded_scans',
        'U of recorded scans',
        f'Mean U of the recorded scans of {recorded.clean}, as they are and degraded on their bytes{others}.',
        ('method', *conditions),
        rows,
    )
