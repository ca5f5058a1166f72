"""What methods cost."""

from __future__ import annotations

import math

from offradar_ros.lab.report.labels import method_label
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source


def cost_table(source: Source) -> TableSection:
    """Time and memory of every method."""
    machine, methods = source.results.machine, source.results.methods
    rows = []
    for name in source.methods:
        cost = methods[name].cost
        numbers = (cost.encode_ms, cost.search_ms, cost.bytes_per_place / 1000.0)
        texts = ('-' if math.isnan(value) else f'{value:.3g}' for value in numbers)
        rows.append((method_label(name), str(methods[name].dimension), *texts))
    return TableSection(
        'cost',
        'Cost',
        f'Medians on {machine.processor}, {machine.cores} cores: encoding one scan from its polar image, finding '
        'ten places in a map of mean size; memory of a descriptor. Peak memory of the evaluation: '
        f'{max(method.cost.peak_memory_mb for method in methods.values()):.0f} MB.',
        ('method', 'dimension', 'encode (ms)', 'search (ms)', 'per place (kB)'),
        tuple(rows),
    )
