"""Recall of the queries on the map against the precision of all answers, for each confidence."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from offradar_ros.lab.evaluation.confidences import CONFIDENCES
from offradar_ros.lab.evaluation.metrics.pair_level import RECALLS
from offradar_ros.lab.evaluation.plots import new_figure
from offradar_ros.lab.report.curves import COLOURS, png_of
from offradar_ros.lab.report.labels import method_label
from offradar_ros.lab.report.sections import FigureSection
from offradar_ros.lab.report.source import Source

LOWEST = 0.9
"""Least precision that is shown."""


def open_set_figures(source: Source) -> Iterator[FigureSection]:
    """A figure for each group with queries on the map: a row for each method, a panel for each map spacing."""
    for group in source.groups:
        if not next(iter(source.results.groups[group][source.spacings[0]].values())).with_positive:
            continue
        figure = new_figure(5.2 * len(source.spacings), 3.6 * len(source.methods))
        panels = figure.subplots(len(source.methods), len(source.spacings), squeeze=False, sharex=True, sharey=True)
        for row, method in zip(panels, source.methods, strict=True):
            for axis, spacing in zip(row, source.spacings, strict=True):
                found = source.results.groups[group][spacing][method].open_set
                for (name, label), colour in zip(CONFIDENCES.items(), COLOURS, strict=True):
                    if name not in found.confidences or not found.confidences[name].precisions:
                        continue
                    precisions = np.array(found.confidences[name].precisions, np.float64)
                    shown = (precisions >= LOWEST) & (RECALLS > 0.0)
                    width = 2.2 if name == 'p_right' else 1.2
                    axis.plot(100 * precisions[shown], 100 * RECALLS[shown], color=colour, label=label, lw=width)
                axis.set_title(f'{method_label(method)}, map spacing {spacing} m', fontsize='small')
                axis.set_xlim(100 * LOWEST, 100)
                axis.set_ylim(0, 100)
                axis.grid(alpha=0.3)
            row[0].set_ylabel('answered rightly, of the queries on the map (%)', fontsize='small')
        for axis in panels[-1]:
            axis.set_xlabel('precision of all answers (%)')
        panels[0][0].legend(fontsize='x-small', loc='upper right')
        scans = source.results.scans(group)
        figure.suptitle(f'{source.results.title(group)} ({scans})', fontsize='medium')
        yield FigureSection(
            f'open_set_{group}',
            f'Recall at a precision: {source.results.title(group)}',
            'Share of the queries on the map that is answered rightly, against the precision of the answers to all '
            'queries, as the threshold on each confidence falls. A confidence without a line never reaches a precision '
            f'of {LOWEST:.0%}; {scans}.',
            f'Recall against precision for {len(CONFIDENCES)} confidences and {len(source.methods)} methods',
            png_of(figure),
        )
