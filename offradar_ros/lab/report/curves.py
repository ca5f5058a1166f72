"""Curves of a report: Recall@RR, precision and recall."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.evaluation.methods import OURS
from offradar_ros.lab.evaluation.metrics.pair_level import RECALLS, precisions_at
from offradar_ros.lab.evaluation.metrics.precision_recall import precision_recall
from offradar_ros.lab.evaluation.metrics.recall_at_rejection import rejection_curve
from offradar_ros.lab.evaluation.plots import SHARES, new_figure
from offradar_ros.lab.report.labels import METHOD_NAMES
from offradar_ros.lab.report.sections import FigureSection
from offradar_ros.lab.report.source import Source

COLOURS = ('#0072B2', '#E69F00', '#009E73', '#CC79A7', '#56B4E9', '#8C8C8C', '#D55E00')
"""Colours of Okabe and Ito, distinguishable with most kinds of colour vision; the main method has the last."""


ZOOM_BELOW = 0.2
"""Share of wrong answers of the main method below which a panel with a zoomed axis is added."""


def png_of(figure: Any) -> bytes:
    """The figure as PNG."""
    file = io.BytesIO()
    figure.savefig(file, format='png')
    return file.getvalue()


def colour_of(source: Source, method: str) -> str:
    """The colour of a method, the same in every figure."""
    if method == source.main_method:
        return COLOURS[-1]
    return COLOURS[source.methods.index(method) % (len(COLOURS) - 1)]


def rejection_figures(source: Source) -> Iterator[FigureSection]:
    """Recall@1 against the share of rejected queries, as in the paper; a figure for each group."""
    for group in source.groups:
        panels = [(spacing, False) for spacing in source.spacings]
        panels += [(spacing, True) for spacing in source.spacings if 0.0 < _lost(source, group, spacing) < ZOOM_BELOW]
        figure = new_figure(5.2 * len(panels), 4.0)
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for axis, (spacing, zoomed) in zip(axes, panels, strict=True):
            for method in source.methods:
                ours = method == OURS
                label = 'OURS(Q)' if ours else METHOD_NAMES.get(method, method)
                rows = source.query_rows(group, spacing, method)
                axis.plot(
                    100 * SHARES,
                    100 * _rejection(rows),
                    color=colour_of(source, method),
                    label=label,
                    lw=2.2 if ours else 1.2,
                )
                maintained = source.query_rows(group, spacing, method, maintained=True)
                if ours and len(maintained):
                    axis.plot(
                        100 * SHARES, 100 * _rejection(maintained), '--', color=COLOURS[-1], label='OURS(QM)', lw=2.2
                    )
            if zoomed:
                lost = 100.0 * _lost(source, group, spacing)
                axis.set_ylim(100.0 - max(3.0 * lost, 1.0), 100.0 + max(0.15 * lost, 0.05))
            suffix = ', zoomed' if zoomed else ''
            axis.set_title(f'{source.results.scans(group)}, map spacing {spacing} m{suffix}', fontsize='small')
            axis.set_xlabel('rejected, most uncertain first (%)')
            axis.grid(alpha=0.3)
        axes[0].set_ylabel('Recall@1 of the rest (%)')
        axes[0].legend(fontsize='x-small')
        with_zoom = '; right: zoomed to the best methods' if any(zoomed for _, zoomed in panels) else ''
        ours_words = ' OURS(Q) searches the map of one drive, OURS(QM) the maintained map.' * (OURS in source.methods)
        yield FigureSection(
            f'recall_at_rejection_{group}',
            f'Introspective query rejection: {source.results.title(group)}',
            'Recall@1 as the most uncertain queries are rejected'
            f'{with_zoom}.{ours_words} {source.results.scans(group).capitalize()}.',
            f'Curves of Recall@1 against the rejected share for {len(source.methods)} methods',
            png_of(figure),
        )


def _lost(source: Source, group: str, spacing: str) -> float:
    """Share of wrong answers of the main method; NaN without queries."""
    rows = source.query_rows(group, spacing, source.main_method)
    return 1.0 - float(np.mean(rows['rank'] == 0)) if len(rows) else math.nan


def _rejection(rows: NDArray[Any]) -> NDArray[np.float64]:
    curve = rejection_curve(rows['uncertainty'], rows['rank'] == 0)
    return np.array([curve.recall_at(share) for share in SHARES])


def precision_recall_figures(source: Source) -> Iterator[FigureSection]:
    """Precision against recall, of the nearest place of each query and of all pairs of queries and places."""
    for group in source.groups:
        spacing = source.spacings[0]
        figure = new_figure(10.4, 4.0)
        nearest, pairs = figure.subplots(1, 2, sharey=True)
        for method in source.methods:
            rows = source.query_rows(group, spacing, method)
            distances = np.where(np.isfinite(rows['uncertainty']), rows['distance'], np.inf)
            curve = precision_recall(distances, rows['rank'] == 0, float(len(rows)))
            highest_recall = curve.recall[-1] if len(curve.recall) else 0.0
            style = {
                'color': colour_of(source, method),
                'label': METHOD_NAMES.get(method, method),
                'lw': 2.2 if method == OURS else 1.2,
            }
            shown = highest_recall >= RECALLS
            nearest.plot(100 * RECALLS[shown], 100 * precisions_at(curve, RECALLS)[shown], **style)
            precisions = source.results.groups[group][spacing][method].pair_level.precisions
            if precisions:
                pairs.plot(100 * RECALLS, 100 * np.array(precisions, np.float64), **style)
        for axis, title in ((nearest, 'nearest place of each query'), (pairs, 'every query with every place')):
            axis.set_title(title, fontsize='small')
            axis.set_xlabel('recall (%)')
            axis.set_xlim(0, 100)
            axis.set_ylim(0, 101)
            axis.grid(alpha=0.3)
        nearest.set_ylabel('precision (%)')
        nearest.legend(fontsize='x-small')
        figure.suptitle(
            f'{source.results.title(group)}, map spacing {spacing} m ({source.results.scans(group)})', fontsize='medium'
        )
        yield FigureSection(
            f'precision_recall_{group}',
            f'Precision and recall: {source.results.title(group)}',
            'Over thresholds on the distance in embedding space. Left: the nearest place of each query, correct within '
            'the tolerance. Right: pairs of a query and any place of the map, positive within the tolerance, negative '
            'beyond the distance of negatives, left out between the two; mean over pairs of drives; '
            f'{source.results.scans(group)}.',
            f'Precision against recall for {len(source.methods)} methods, of answers and of pairs',
            png_of(figure),
        )
