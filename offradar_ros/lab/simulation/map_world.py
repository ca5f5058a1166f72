"""A world from the occupied cells of a nav2 map, as a lidar has drawn them.

Cells that touch are one thing. Things of under half a square metre become scatterers, the others walls along their
outlines, simplified to 0.3 m. What a thing is made of follows from its outline, because a map does not say: long
straight walls are buildings, ragged outlines are vegetation; the rest is drawn from the seed.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.map_image import MapImage, read_map_image
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.world import World

Array = NDArray[np.float64]

_SPECK_M2 = 0.5
_SIMPLIFIED_M = 0.3
_COARSER_M = 1.2
_STRAIGHT_M = 6.0
"""Outlines that are straight over this length on average, simplified to `_COARSER_M`, are those of buildings."""

_BUILDING_THROUGH = 0.01
_VEGETATION_THROUGH = 0.5
_MOST_WALLS = 2_000_000


def load_map_world(path: str | Path, seed: int = 0) -> World:
    """The world of a nav2 map's YAML file; it has no streets: traversals of it need a recorded path.

    `seed` draws what things return. DataError for a damaged map and for one without occupied cells.
    """
    image = read_map_image(path)
    outlines = _outlines(image)
    if not outlines:
        raise DataError(f'{path}: no cell of the map is occupied: expected a map of something')
    areas = np.array([area for _, area in outlines]) * image.resolution_m**2
    corners = [image.to_world(points.astype(np.float64)) for points, _ in outlines]
    rng = np.random.default_rng([seed, 8])
    specks = areas < _SPECK_M2
    walls, wall_powers, wall_through, points, powers = _things(
        rng, [c for c, speck in zip(corners, specks, strict=True) if not speck]
    )
    if len(walls) > _MOST_WALLS:
        raise DataError(f'{path}: expected outlines of up to {_MOST_WALLS} walls, got {len(walls)}')
    dots = np.array([c.mean(axis=0) for c, speck in zip(corners, specks, strict=True) if speck]).reshape(-1, 2)
    dot_powers = _from_decibels(rng.uniform(14.0, 40.0, len(dots)) + 10.0 * np.log10(0.2 + areas[specks] / _SPECK_M2))
    return World(
        Reflectors(walls, wall_powers, wall_through, np.vstack([points, dots]), np.concatenate([powers, dot_powers]))
    )


def _outlines(image: MapImage) -> list[tuple[NDArray[np.int32], int]]:
    """Simplified outline, (K, 2) column and row of pixels, and number of cells of every group that touches."""
    cells = image.occupied.astype(np.uint8)
    found, _ = cv2.findContours(cells, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    tolerance = _SIMPLIFIED_M / image.resolution_m
    outlines = []
    for contour in found:
        area = round(cv2.contourArea(contour)) + len(contour) // 2 + 1
        outlines.append((cv2.approxPolyDP(contour, tolerance, True)[:, 0].astype(np.int32), area))
    return outlines


def _things(rng: np.random.Generator, outlines: list[Array]) -> tuple[Array, Array, Array, Array, Array]:
    """Walls with powers and shares that pass, and the bright points on them."""
    walls: list[Array] = [np.empty((0, 2, 2))]
    surfaces: list[Array] = [np.empty((0, 2))]
    points: list[Array] = [np.empty((0, 2))]
    powers: list[Array] = [np.empty(0)]
    for outline in outlines:
        sides = _sides(outline)
        lengths = np.hypot(*(sides[:, 1] - sides[:, 0]).T)
        straight = _is_straight(outline)
        decibels = float(rng.uniform(48.0, 62.0) if straight else rng.uniform(26.0, 44.0))
        # A ray passes an outline twice, a line once: together as much as through one thing.
        through = (_BUILDING_THROUGH if straight else _VEGETATION_THROUGH) ** (
            0.5 if len(sides) == len(outline) else 1.0
        )
        walls.append(sides)
        surfaces.append(np.tile([10.0 ** (decibels / 10.0), through], (len(sides), 1)))
        counts = rng.poisson(lengths / rng.uniform(2.0, 8.0))
        chosen = np.repeat(np.arange(len(sides)), counts)
        along = rng.random((len(chosen), 1))
        points.append((1.0 - along) * sides[chosen, 0] + along * sides[chosen, 1])
        powers.append(_from_decibels(min(decibels, 54.0) - rng.uniform(4.0, 22.0, len(chosen))))
    made = np.concatenate(surfaces)
    return np.concatenate(walls), made[:, 0], made[:, 1], np.concatenate(points), np.concatenate(powers)


def _sides(outline: Array) -> Array:
    """(W, 2, 2) sides of a closed outline, without those that it goes back along: a thin thing's are met once."""
    following = np.roll(outline, -1, axis=0)
    one_way = np.where(
        _before(outline, following)[:, None], np.hstack([outline, following]), np.hstack([following, outline])
    )
    distinct = np.unique(one_way, axis=0)
    distinct = distinct[np.any(distinct[:, :2] != distinct[:, 2:], axis=1)]
    return distinct.reshape(-1, 2, 2)


def _is_straight(outline: Array) -> bool:
    coarse = cv2.approxPolyDP(outline.astype(np.float32)[:, None], _COARSER_M, True)[:, 0]
    lengths = np.hypot(*(np.roll(coarse, -1, axis=0) - coarse).T)
    return bool(np.sum(lengths**2) > _STRAIGHT_M * np.sum(lengths))


def _before(points: Array, others: Array) -> NDArray[np.bool_]:
    return np.asarray((points[:, 0] < others[:, 0]) | ((points[:, 0] == others[:, 0]) & (points[:, 1] < others[:, 1])))


def _from_decibels(decibels: Array) -> Array:
    return np.asarray(10.0 ** (decibels / 10.0))
