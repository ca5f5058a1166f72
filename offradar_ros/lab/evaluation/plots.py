"""Plots of results. They need matplotlib, which is imported when one is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.methods import OURS
from offradar_ros.lab.evaluation.metrics.recall_at_rejection import rejection_curve
from offradar_ros.lab.evaluation.protocol import ALL, Protocol

SHARES = np.linspace(0.0, 0.95, 96)


def draw_rejection_curves(several: Sequence[Answers], protocol: Protocol, path: Path) -> None:
    """Recall@RR of every method, a panel for each map spacing and group."""
    groups = sorted({a.pair.group for a in several})
    words = ', '.join(sorted({group.scans for group in protocol.groups if group.name in groups}))
    groups += [ALL] * (len(groups) > 1)
    methods = list(dict.fromkeys(a.pair.method for a in several))
    figure = new_figure(4.0 * len(groups), 3.4 * len(protocol.map_spacings_m))
    axes = figure.subplots(len(protocol.map_spacings_m), len(groups), squeeze=False, sharey=True)
    for row, spacing_m in enumerate(protocol.map_spacings_m):
        for column, group in enumerate(groups):
            axis = axes[row][column]
            for method in methods:
                chosen = [
                    a
                    for a in several
                    if a.pair.method == method and a.pair.spacing_m == spacing_m and group in (ALL, a.pair.group)
                ]
                axis.plot(SHARES, _curve(chosen), label=method, linewidth=2.0 if method == OURS else 1.0)
            axis.set_title(f'{group}, a map every {spacing_m:g} m', fontsize='small')
            axis.set_xlabel('share of queries rejected, most uncertain first', fontsize='small')
            axis.grid(alpha=0.3)
        axes[row][0].set_ylabel('Recall@1 of the rest')
    axes[0][0].legend(fontsize='x-small')
    figure.suptitle(f'Recall at rejection, {words}: {protocol.title}', fontsize='medium')
    save_picture(figure, path)


def draw_severity(several: Sequence[Answers], path: Path) -> None:
    """U of each scan against its severity, a panel for each kind of degradation; clean scans are at 0."""
    once = list({(a.pair.group, a.pair.world, a.pair.query_index): a for a in several}.values())
    kinds, severities, uncertainties = (
        np.concatenate([getattr(a, name) for a in once]) for name in ('kinds', 'severities', 'uncertainties')
    )
    names = sorted(set(kinds.tolist()) - {''})
    columns = max(1, min(3, len(names)))
    rows = max(1, -(-len(names) // columns))
    figure = new_figure(4.0 * columns, 3.2 * rows)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for axis, name in zip(axes, names, strict=False):
        for chosen, colour in ((kinds == '', '0.7'), (kinds == name, 'tab:red')):
            axis.scatter(severities[chosen], uncertainties[chosen], s=6, c=colour, linewidths=0)
        axis.set_title(name, fontsize='small')
        axis.set_xlabel('severity', fontsize='small')
        axis.set_ylabel('U', fontsize='small')
        axis.grid(alpha=0.3)
    method = once[0].pair.method
    figure.suptitle(f'U of {method} against severity, simulated scans (clean ones grey)', fontsize='medium')
    save_picture(figure, path)


def _curve(several: Sequence[Answers]) -> NDArray[np.float64]:
    keep = [a.positive for a in several]
    curve = rejection_curve(
        np.concatenate([a.uncertainties[k] for a, k in zip(several, keep, strict=True)]),
        np.concatenate([a.correct[k] for a, k in zip(several, keep, strict=True)]),
    )
    return np.array([curve.recall_at(share) for share in SHARES])


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty matplotlib figure that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width_in, height_in), layout='constrained', dpi=110)
    FigureCanvasAgg(figure)
    return figure
