"""Pictures of worlds from above, with drives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.world import World

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection

_OPAQUE = 0.3
"""Walls that transmit less are drawn black, others blue."""

_CAR_M = np.array([4.4, 1.8])


@dataclasses.dataclass(frozen=True, eq=False)
class Panel:
    """One world to draw.

    Attributes:
        title: text above the panel.
        drives: (N, 3) or (N, 2) poses of each; if empty, the world's route is drawn.
        size_m: side of the square that is drawn; None for the whole world.
        centre_m: (2,) its middle; None for the first pose.
    """

    title: str
    world: World
    drives: Sequence[NDArray[np.float64]] = ()
    size_m: float | None = None
    centre_m: NDArray[np.float64] | None = None


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
    """Draw walls (dark: strong; blue: transmitting), vegetation (green), poles (purple) and parking places (orange).

    Where vehicles can drive is grey; drives are red.
    """
    world = panel.world
    scale = 1.0 if panel.size_m is None else 3.0
    if world.road is not None:
        shade = np.where(world.road.free, 0.85, 1.0)
        axes.imshow(shade, cmap='gray', vmin=0.0, vmax=1.0, origin='lower', extent=world.road.extent_m)
    _draw_reflectors(axes, world.vegetation, scale, 'tab:green', 'tab:green')
    _draw_reflectors(axes, world.reflectors, scale, 'tab:purple', 'blue')
    axes.add_collection(_segments(_car_sides(world.parking), 'tab:orange', 0.3 * scale))
    lines = [poses[:, :2] for poses in panel.drives] or ([world.route.points_m] if world.route else [])
    for line in lines:
        axes.plot(line[:, 0], line[:, 1], linewidth=1.5, color='tab:red')
    if panel.size_m is not None and (lines or panel.centre_m is not None):
        (x, y), half = lines[0][0] if panel.centre_m is None else panel.centre_m, panel.size_m / 2
        axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    axes.set(aspect='equal', title=panel.title, xlabel='east, m', ylabel='north, m')


def _draw_reflectors(axes: Axes, seen: Reflectors, scale: float, points: str, transmitting: str) -> None:
    strength = np.clip((_decibels(seen.scatterer_powers) - 15.0) / 35.0, 0.1, 1.0)
    axes.scatter(seen.scatterers_m[:, 0], seen.scatterers_m[:, 1], s=scale * strength**2, c=points, linewidths=0)
    opaque = seen.wall_transmission < _OPAQUE
    for walls, colour in ((opaque, 'black'), (~opaque, transmitting)):
        if walls.any():
            alpha = np.clip((_decibels(seen.wall_powers[walls]) - 15.0) / 40.0, 0.2, 1.0)
            axes.add_collection(_segments(seen.walls_m[walls], colour, 0.6 * scale, alpha))


def _segments(
    walls_m: NDArray[np.float64], colour: str, width: float, alpha: NDArray[np.float64] | None = None
) -> LineCollection:
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    return LineCollection(list(walls_m), colors=colour, linewidths=width, alpha=alpha)


def _car_sides(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4 K, 2, 2) sides of a car at each of (K, 3) parking places."""
    cosine, sine = np.cos(places[:, 2:]), np.sin(places[:, 2:])
    x, y = (_CAR_M * np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])).T
    corners = np.stack([places[:, :1] + cosine * x - sine * y, places[:, 1:2] + sine * x + cosine * y], axis=-1)
    return np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 2)


def _decibels(powers: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(10.0 * np.log10(np.maximum(powers, 1e-3)))
