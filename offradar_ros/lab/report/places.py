"""Maps before and after maintenance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from offradar_ros.lab.evaluation.plots import new_figure
from offradar_ros.lab.evaluation.results.results import spacing_key
from offradar_ros.lab.report.curves import png_of
from offradar_ros.lab.report.sections import FigureSection
from offradar_ros.lab.report.source import Source

MOST_WORLDS = 6
"""Number of worlds that are drawn."""


def map_figures(source: Source) -> Iterator[FigureSection]:
    """The map of the first drive of each world, before and after the others were merged, coloured by U."""
    spacing = source.spacings[0]
    listed = [
        (number, kept)
        for number, kept in enumerate(source.results.maps)
        if (kept.pair.method, spacing_key(kept.pair.spacing_m)) == (source.main_method, spacing)
    ]
    for number, kept in listed[:MOST_WORLDS]:
        before, after = source.maps[f'before_{number}'], source.maps[f'after_{number}']
        low, high = np.quantile(np.concatenate([before[:, 2], after[:, 2]]), [0.02, 0.98])
        figure = new_figure(11.0, 4.6)
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        for axis, places, word in zip(axes, (before, after), ('before', 'after'), strict=True):
            dots = axis.scatter(places[:, 0], places[:, 1], s=7, c=places[:, 2], cmap='viridis', vmin=low, vmax=high)
            axis.set_title(f'{word}: mean U {places[:, 2].mean():.3f}', fontsize='small')
            axis.set_aspect('equal')
            axis.set_xlabel('east (m)')
            axis.grid(alpha=0.3)
        axes[0].set_ylabel('north (m)')
        figure.colorbar(dots, ax=axes, label='U of the scan that a place holds', extend='both')
        pair, word = kept.pair, source.results.scans(kept.pair.group)
        figure.suptitle(f'{pair.world} ({word})', fontsize='medium')
        yield FigureSection(
            f'map_{pair.group}_{pair.world}',
            f'Map maintenance: {pair.world}',
            f'The map of one drive ({len(before)} places) before and after the others were merged: {kept.replaced} '
            f'replacements at {kept.opportunities} opportunities, at constant size; {word}.',
            f'Two maps of {len(before)} places coloured by U, before and after maintenance',
            png_of(figure),
        )
