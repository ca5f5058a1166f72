"""Pictures of worlds from above, with drives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.lab.simulation.world import World

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OPAQUE = 0.3
"""Walls that transmit less are drawn black, others blue."""


@dataclasses.dataclass(frozen=True, eq=False)
class Panel:
    """One world to draw.

    Attributes:
        title: text above the panel.
        drives: (N, 3) or (N, 2) poses of each; if empty, the world's route is drawn.
        size_m: side of the square that is drawn around the first pose; None for the whole world.
    """

    title: str
    world: World
    drives: Sequence[NDArray[np.float64]] = ()
    size_m: float | None = None


def draw_worlds(path: str | Path, panels: Sequence[Panel]) -> None:
    """Write a PNG file with three panels in a row. Needs matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(5.5 * columns, 5.6 * rows), layout='constrained')
    FigureCanvasAgg(figure)
    for axes, panel in zip(figure.subplots(rows, columns, squeeze=False).flat, panels, strict=False):
        draw_world(axes, panel)
    save_picture(figure, path, dpi=80)


def draw_world(axes: Axes, panel: Panel) -> None:
    """Draw walls (dark: strong; blue: transmitting), scatterers (green), parking places (orange) and drives (red)."""
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    world, seen = panel.world, panel.world.reflectors
    scale = 1.0 if panel.size_m is None else 3.0
    strength = np.clip((_decibels(seen.scatterer_powers) - 15.0) / 35.0, 0.1, 1.0)
    points, parking = seen.scatterers_m, world.parking
    axes.scatter(points[:, 0], points[:, 1], s=scale * strength**2, c='tab:green', linewidths=0)
    axes.scatter(parking[:, 0], parking[:, 1], s=2.0 * scale**2, c='tab:orange', linewidths=0)
    colours = np.zeros((len(seen.walls_m), 4))
    colours[:, 2] = np.where(seen.wall_transmission > _OPAQUE, 0.9, 0.0)
    colours[:, 3] = np.clip((_decibels(seen.wall_powers) - 15.0) / 40.0, 0.2, 1.0)
    axes.add_collection(LineCollection(list(seen.walls_m), colors=colours, linewidths=0.6 * scale))
    lines = [poses[:, :2] for poses in panel.drives] or ([world.route.points_m] if world.route else [])
    for line in lines:
        axes.plot(line[:, 0], line[:, 1], linewidth=1.5, color='tab:red')
    if panel.size_m is not None and lines:
        (x, y), half = lines[0][0], panel.size_m / 2
        axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    axes.set(aspect='equal', title=panel.title, xlabel='east, m', ylabel='north, m')


def _decibels(powers: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(10.0 * np.log10(np.maximum(powers, 1e-3)))
