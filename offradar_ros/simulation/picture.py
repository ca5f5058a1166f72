"""A world from above, with what drove through it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from offradar_ros.simulation.world import World

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_world(
    axes: Axes, world: World, drives: Sequence[NDArray[np.float64]] = (), size_m: float | None = None
) -> None:
    """Walls (darker: stronger, blue: half open), scatterers, places to park and (N, 3) poses of drives.

    `size_m` draws that much, round the first pose of the first drive (or the route's first point).
    """
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    seen = world.reflectors
    strengths = np.clip((_decibels(seen.wall_powers) - 15.0) / 45.0, 0.15, 1.0)
    colours = np.zeros((len(strengths), 4))
    colours[:, 2], colours[:, 3] = np.where(seen.wall_through > 0.3, 0.9, 0.0), strengths
    points = np.clip((_decibels(seen.scatterer_powers) - 20.0) / 35.0, 0.05, 1.0)
    axes.scatter(
        seen.scatterers_m[:, 0],
        seen.scatterers_m[:, 1],
        s=3.0 * points**2,
        c='tab:green',
        linewidths=0,
        rasterized=True,
    )
    axes.scatter(world.parking[:, 0], world.parking[:, 1], s=2.0, c='tab:orange', linewidths=0)
    axes.add_collection(LineCollection(list(seen.walls_m), colors=colours, linewidths=0.7))
    lines = [poses[:, :2] for poses in drives] or ([world.route.points_m] if world.route else [])
    for line in lines:
        axes.plot(*line.T, linewidth=1.0)
    if size_m and lines:
        (x, y), half = lines[0][0], size_m / 2
        axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    axes.set(aspect='equal', xlabel='east, m', ylabel='north, m')


def picture_of_worlds(path: str | Path, worlds: Sequence[tuple[str, World, Sequence[NDArray[np.float64]]]]) -> None:
    """One panel for each (title, world, drives), as a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    columns = min(3, len(worlds))
    rows = -(-len(worlds) // columns)
    figure = Figure(figsize=(6.5 * columns, 6.5 * rows), layout='constrained')
    FigureCanvasAgg(figure)
    for axes, (title, world, drives) in zip(figure.subplots(rows, columns, squeeze=False).flat, worlds, strict=False):
        draw_world(axes, world, drives)
        axes.set_title(title)
    figure.savefig(path, dpi=80)


def _decibels(powers: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(10.0 * np.log10(np.maximum(powers, 1e-3)))
