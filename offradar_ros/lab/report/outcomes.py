"""Every query of a search at its position, by its outcome, and the road that is not mapped."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from numpy.typing import NDArray

from offradar_ros.lab.evaluation.answers import Pair
from offradar_ros.lab.evaluation.plots import new_figure
from offradar_ros.lab.evaluation.results.open_set import GateFigures
from offradar_ros.lab.evaluation.results.results import spacing_key
from offradar_ros.lab.report.curves import png_of
from offradar_ros.lab.report.places import MOST_WORLDS
from offradar_ros.lab.report.sections import FigureSection
from offradar_ros.lab.report.source import Source

RIGHT, WRONG, OFF_MAP, REJECTED = '#009E73', '#D55E00', '#6A1B78', '#444444'
UNMAPPED_ROAD = '#F0C9DF'


def outcome_figures(source: Source) -> Iterator[FigureSection]:
    """The first pair of drives of some worlds of each group, a panel for each map that is made of the first drive."""
    spacing = source.spacings[0]
    found: dict[tuple[str, str], list[int]] = {}
    for number, search in enumerate(source.results.searches):
        pair = search.pair
        if (pair.method, spacing_key(pair.spacing_m), search.maintained) != (source.main_method, spacing, False):
            continue
        numbers = found.setdefault((pair.group, pair.world), [])
        if not numbers or _drives(source.results.searches[numbers[0]].pair) == _drives(pair):
            numbers.append(number)
    groups = {group for group, _ in found}
    shown = dict.fromkeys(groups, max(MOST_WORLDS // len(groups), 1))
    for (group, _), numbers in found.items():
        shown[group] -= 1
        if shown[group] >= 0:
            yield _figure(source, numbers)


def _drives(pair: Pair) -> tuple[int, int]:
    return pair.map_index, pair.query_index


def _figure(source: Source, numbers: Sequence[int]) -> FigureSection:
    pair = source.results.searches[numbers[0]].pair
    figure = new_figure(8.2 * len(numbers), 6.0)
    for axis, number in zip(figure.subplots(1, len(numbers), squeeze=False)[0], numbers, strict=True):
        _draw(axis, source.rows[source.rows['pair'] == number])
    names = {
        drive.index: drive.name
        for drive in source.results.drives
        if (drive.group, drive.world) == (pair.group, pair.world)
    }
    mapped, query = names[pair.map_index], names[pair.query_index]
    word = source.results.scans(pair.group)
    gate = source.results.groups[pair.group][source.spacings[0]][source.main_method].open_set.gate
    parts = ', of which a part is left out' if source.results.protocol.leaves_out else ''
    figure.suptitle(f'{query}\nsearched for in the map of {mapped}{parts} ({word}, {_rule(gate)})', fontsize='small')
    return FigureSection(
        f'trajectory_{pair.group}_{pair.world}',
        f'Queries on the map: {pair.world}',
        f'Every query of {query} in the map of {mapped}{parts}: answered rightly or wrongly, or rejected '
        f'({_rule(gate)}). Pale: road that is not mapped, where every answer is wrong; {word}.',
        'Queries on a map, coloured by outcome, and the road that is not mapped',
        png_of(figure),
    )


def _rule(gate: GateFigures) -> str:
    if math.isnan(gate.limit):
        return 'every query is answered'
    return f'answered if {gate.rule} is at {"least" if gate.rule == "p_right" else "most"} {gate.limit:.3g}'


def _draw(axis: Any, rows: NDArray[Any]) -> None:
    right, on_map, answered = rows['rank'] == 0, rows['positive'], rows['answered']
    kinds = (
        ('road that is not mapped', UNMAPPED_ROAD, 'o', ~on_map, 150),
        ('right answer', RIGHT, 'o', answered & right, 16),
        ('wrong answer', WRONG, 's', answered & ~right & on_map, 22),
        ('answered off the map', OFF_MAP, 'D', answered & ~on_map, 26),
        ('rejected, would be right', REJECTED, '+', ~answered & right, 18),
        ('rejected, would be wrong', '#000000', 'x', ~answered & ~right & on_map, 14),
        ('rejected off the map', '#999999', '.', ~answered & ~on_map, 10),
    )
    for label, colour, marker, chosen, size in kinds:
        if not chosen.any():
            continue
        axis.scatter(
            rows['x_m'][chosen],
            rows['y_m'][chosen],
            s=size,
            c=colour,
            marker=marker,
            linewidths=1.2 if marker in '+x' else 0,
            label=label if size > 100 else f'{label}: {int(chosen.sum())}',
        )
    axis.set_aspect('equal', 'datalim')
    axis.set_xlabel('east (m)')
    axis.set_ylabel('north (m)')
    axis.grid(alpha=0.3)
    axis.legend(fontsize='x-small', markerscale=0.8)
