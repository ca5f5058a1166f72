"""Picture of the demonstration: what was answered where, with the gate of the run and with the paper's rule."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.lab.demo.truth import ComparedDrive

Mask = NDArray[np.bool_]

_LEAST_P = 1e-4
"""Probabilities are drawn between this and one minus this."""


class Style(NamedTuple):
    """Colours are those of Okabe and Ito, which the colour-blind tell apart; each has a marker of its own too."""

    label: str
    marker: str
    colour: str
    size: float


RIGHT = Style('answered, right', '.', '#009E73', 28)
WRONG = Style('answered, wrong', 'x', '#D55E00', 30)
REJECTED_RIGHT = Style('rejected on the map, would be right', '+', '#000000', 48)
REJECTED_WRONG = Style('rejected on the map, would be wrong', 'd', '#CC79A7', 26)
REJECTED_OFF = Style('rejected off the map', 'o', '#56B4E9', 22)


def draw_map(mapped: ComparedDrive, queried: ComparedDrive, min_probability: float, path: Path) -> None:
    """Draw the answers to one drive on the map that `mapped` began: two maps, and the probabilities over time.

    On the left are the answers of the run, on the right those that the paper's rule on U gives to the same scans.
    """
    figure = Figure(figsize=(13, 10))
    grid = figure.add_gridspec(2, 2, height_ratios=(2.6, 1), left=0.06, right=0.98, top=0.93, bottom=0.14, hspace=0.2)
    left = figure.add_subplot(grid[0, 0])
    right = figure.add_subplot(grid[0, 1], sharex=left, sharey=left)
    for axes, accepted, gate in (
        (left, queried.accepted, f'p_right of {min_probability:g} or more'),
        (right, queried.paper_accepts, "the paper's rule on U alone"),
    ):
        _draw_roads(axes, mapped, queried)
        _draw_answers(axes, queried, accepted)
        axes.set(aspect='equal', title=f'{gate}: {_counts(queried, accepted)}', xlabel='east, m')
    left.set_ylabel('north, m')
    below = figure.add_subplot(grid[1, :])
    _draw_probabilities(below, queried, min_probability)
    found = dict(zip(*reversed(left.get_legend_handles_labels()), strict=True))
    found |= dict(zip(*reversed(below.get_legend_handles_labels()), strict=True))
    figure.legend(found.values(), found.keys(), loc='lower center', ncols=4, frameon=False)
    figure.suptitle(f'{queried.replayed.drive.name} in a map of {len(queried.replayed.places)} places (simulated)')
    FigureCanvasAgg(figure)
    save_picture(figure, path)


def _counts(queried: ComparedDrive, accepted: Mask) -> str:
    right = accepted & queried.nearest_is_right
    return f'{int(right.sum())} answers right, {int((accepted & ~right).sum())} wrong'


def _draw_roads(axes: Axes, mapped: ComparedDrive, queried: ComparedDrive) -> None:
    axes.plot(
        *mapped.positions_m.T, color='#DDDDDD', linewidth=13, solid_capstyle='round', label='mapped road', zorder=0
    )
    off_m = np.where(queried.off_map[:, None], queried.positions_m, np.nan)
    axes.plot(*off_m.T, color='#F7EFA0', linewidth=13, label='road that was never mapped', zorder=0)
    places_m = queried.replayed.places.positions_m
    axes.scatter(places_m[:, 0], places_m[:, 1], s=60, facecolors='none', edgecolors='#AAAAAA', label='place', zorder=1)


def _draw_answers(axes: Axes, queried: ComparedDrive, accepted: Mask) -> None:
    wrong = accepted & ~queried.nearest_is_right
    firsts = [outcome.candidates[0].pose for outcome, w in zip(queried.replayed.outcomes, wrong, strict=True) if w]
    answered_m = np.array([(pose.x_m, pose.y_m) for pose in firsts]).reshape(-1, 2)
    ends_m = np.stack([queried.positions_m[wrong], answered_m], axis=1)
    lines = LineCollection(list(ends_m), colors=WRONG.colour, linewidths=0.6, alpha=0.5, zorder=2)
    lines.set_label('to the place answered')
    axes.add_collection(lines)
    for style, chosen in _kinds(queried, accepted):
        _scatter(axes, queried.positions_m[chosen], style)


def _draw_probabilities(axes: Axes, queried: ComparedDrive, min_probability: float) -> None:
    stamps_ns = np.array([outcome.stamp_ns for outcome in queried.replayed.outcomes], np.int64)
    seconds = (stamps_ns - stamps_ns.min()) / 1e9
    p_right = np.clip(queried.p_right, _LEAST_P, 1.0 - _LEAST_P)
    axes.set_yscale('logit')
    for style, chosen in _kinds(queried, queried.accepted):
        _scatter(axes, np.column_stack([seconds, p_right])[chosen], style)
    in_order = np.argsort(stamps_ns)
    p_on_map = np.clip(queried.p_on_map, _LEAST_P, 1.0 - _LEAST_P)
    axes.plot(seconds[in_order], p_on_map[in_order], color='#0072B2', linewidth=1.2, label='p_on_map, over many scans')
    degraded = seconds[queried.degraded]
    axes.scatter(degraded, np.full(len(degraded), _LEAST_P / 2), marker='|', s=30, c='#777777', label='degraded scan')
    axes.axhline(min_probability, color='black', linewidth=0.8, linestyle='--', label='gate')
    axes.fill_between(
        seconds, 0, 1, where=queried.off_map, transform=axes.get_xaxis_transform(), color='#F7EFA0', zorder=0
    )
    axes.set(ylim=(_LEAST_P / 3, 1.0 - _LEAST_P / 2), xlim=(seconds.min(), seconds.max()))
    axes.set(xlabel='time of the drive, s', ylabel='p_right, p_on_map')
    axes.set_yticks([1e-3, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999], ['.001', '.01', '.1', '.5', '.9', '.99', '.999'])
    axes.minorticks_off()


def _kinds(queried: ComparedDrive, accepted: Mask) -> tuple[tuple[Style, Mask], ...]:
    """Every scan in one of the five kinds, with its style."""
    right, on_map = queried.nearest_is_right, queried.on_map
    return (
        (RIGHT, accepted & right),
        (REJECTED_OFF, ~accepted & queried.off_map),
        (REJECTED_WRONG, ~accepted & on_map & ~right),
        (REJECTED_RIGHT, ~accepted & on_map & right),
        (WRONG, accepted & ~right),
    )


def _scatter(axes: Axes, points: NDArray[np.float64], style: Style) -> None:
    axes.scatter(
        points[:, 0], points[:, 1], s=style.size, c=style.colour, marker=style.marker, label=style.label, zorder=3
    )
