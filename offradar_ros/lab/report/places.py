"""Maps before and after maintenance, and queries on a map by their outcome."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from offradar_ros.lab.evaluation.answers import Pair
from offradar_ros.lab.evaluation.plots import new_figure
from offradar_ros.lab.evaluation.results.results import spacing_key
from offradar_ros.lab.report.curves import png_of
from offradar_ros.lab.report.sections import FigureSection
from offradar_ros.lab.report.source import Source

CORRECT, WRONG, UNMAPPED, REJECTED = '#009E73', '#D55E00', '#CC79A7', '#444444'
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


def trajectory_figures(source: Source) -> Iterator[FigureSection]:
    """The first search of each world: every query at its position, by its outcome."""
    spacing = source.spacings[0]
    drawn: set[tuple[str, str]] = set()
    for number, search in enumerate(source.results.searches):
        pair = search.pair
        chosen = (pair.method, spacing_key(pair.spacing_m), search.maintained) == (source.main_method, spacing, False)
        if chosen and (pair.group, pair.world) not in drawn and len(drawn) < MOST_WORLDS:
            drawn.add((pair.group, pair.world))
            yield _trajectory(source, number, pair)


def _trajectory(source: Source, number: int, pair: Pair) -> FigureSection:
    rows = source.rows[source.rows['pair'] == number]
    deployed = source.results.groups[pair.group][source.spacings[0]][source.main_method].at_deployed_threshold
    threshold = deployed.threshold if deployed else math.inf
    # Refused scans have an infinite U: they are rejected whatever the threshold.
    answered = np.isfinite(rows['uncertainty']) & (rows['uncertainty'] <= threshold)
    correct = rows['rank'] == 0
    kinds = (
        ('correct match', CORRECT, 'o', answered & correct),
        ('wrong match', WRONG, 's', answered & ~correct & rows['positive']),
        ('wrong match, no positive in the map', UNMAPPED, 'D', answered & ~rows['positive']),
        ('rejected, would be correct', REJECTED, '+', ~answered & correct),
        ('rejected, would be wrong', '#000000', 'x', ~answered & ~correct),
    )
    figure = new_figure(8.2, 5.6)
    axis = figure.subplots()
    for label, colour, marker, chosen in kinds:
        if not chosen.any():
            continue
        axis.scatter(
            rows['x_m'][chosen],
            rows['y_m'][chosen],
            s=16,
            c=colour,
            marker=marker,
            linewidths=1.2 if marker in '+x' else 0,
            label=f'{label}: {int(chosen.sum())}',
        )
    axis.set_aspect('equal', 'datalim')
    axis.set_xlabel('east (m)')
    axis.set_ylabel('north (m)')
    axis.grid(alpha=0.3)
    axis.legend(fontsize='x-small')
    names = {
        drive.index: drive.name
        for drive in source.results.drives
        if (drive.group, drive.world) == (pair.group, pair.world)
    }
    mapped, query = names[pair.map_index], names[pair.query_index]
    word = source.results.scans(pair.group)
    limit = f'threshold {threshold:.3f}' if deployed else 'no threshold'
    figure.suptitle(f'{query}\nsearched for in the map of {mapped} ({word}, {limit})', fontsize='small')
    return FigureSection(
        f'trajectory_{pair.group}_{pair.world}',
        f'Queries on the map: {pair.world}',
        f'Every query of {query} in the map of {mapped}: a correct match, a wrong match (inevitable if the map has no '
        f'positive), or rejected for its U ({limit}); {word}.',
        f'{len(rows)} queries on a map, coloured by outcome',
        png_of(figure),
    )
