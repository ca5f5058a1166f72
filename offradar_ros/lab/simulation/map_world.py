"""A world from the occupied cells of a nav2 map, as lidar mapping makes them.

Cells that touch form one object. Objects of less than half a square metre become scatterers, the others walls along
their outlines, simplified to 0.3 m. A map does not say what an object is made of, so its outline decides: straight
outlines are buildings, ragged ones vegetation (in leaf). The seed draws the rest.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.map_image import MapImage, read_map_image
from offradar_ros.lab.simulation.reflectors import NOTHING, Reflectors, concatenate
from offradar_ros.lab.simulation.world import World

Array = NDArray[np.float64]

_SPECK_M2 = 0.5
_SIMPLIFIED_M = 0.3
_COARSE_M = 1.2
_STRAIGHT_M = 6.0
"""Outlines, simplified to `_COARSE_M`, with straight parts of at least this mean length are those of buildings."""

_BUILDING_TRANSMISSION = 0.01
_VEGETATION_TRANSMISSION = 0.5
_MAX_WALLS = 2_000_000


def load_map_world(path: str | Path, seed: int = 0) -> World:
    """The world of a nav2 map's YAML file. It has no streets: a drive through it needs a recorded path.

    `seed` draws the powers of walls and scatterers. DataError for a damaged map and for one without occupied cells.
    """
    image = read_map_image(path)
    outlines = _outlines(image)
    if not outlines:
        raise DataError(f'{path}: no cell of the map is occupied: expected at least one')
    areas = np.array([area for _, area in outlines]) * image.resolution_m**2
    corners = [image.to_world(points.astype(np.float64)) for points, _ in outlines]
    rng = np.random.default_rng([seed, 8])
    specks = areas < _SPECK_M2
    buildings, vegetation = _objects(rng, [c for c, speck in zip(corners, specks, strict=True) if not speck])
    walls = len(buildings.walls_m) + len(vegetation.walls_m)
    if walls > _MAX_WALLS:
        raise DataError(f'{path}: expected outlines of up to {_MAX_WALLS} walls, got {walls}')
    dots = np.array([c.mean(axis=0) for c, speck in zip(corners, specks, strict=True) if speck]).reshape(-1, 2)
    dot_powers = _from_decibels(rng.uniform(14.0, 40.0, len(dots)) + 10.0 * np.log10(0.2 + areas[specks] / _SPECK_M2))
    poles = dataclasses.replace(NOTHING, scatterers_m=dots, scatterer_powers=dot_powers)
    return World(concatenate(buildings, poles), vegetation, ground_seed=seed)


def _outlines(image: MapImage) -> list[tuple[NDArray[np.int32], int]]:
    """Of every group of cells that touch: simplified outline, (K, 2) column and row of pixels, and number of cells."""
    cells = image.occupied.astype(np.uint8)
    found, _ = cv2.findContours(cells, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    tolerance = _SIMPLIFIED_M / image.resolution_m
    outlines = []
    for contour in found:
        area = round(cv2.contourArea(contour)) + len(contour) // 2 + 1
        outlines.append((cv2.approxPolyDP(contour, tolerance, True)[:, 0].astype(np.int32), area))
    return outlines


def _objects(rng: np.random.Generator, outlines: list[Array]) -> tuple[Reflectors, Reflectors]:
    """Buildings and vegetation: walls, and scatterers on them."""
    found: dict[bool, list[Reflectors]] = {straight: [NOTHING] for straight in (True, False)}
    for outline in outlines:
        sides = _sides(outline)
        lengths = np.hypot(*(sides[:, 1] - sides[:, 0]).T)
        straight = _is_straight(outline)
        decibels = float(rng.uniform(48.0, 62.0) if straight else rng.uniform(26.0, 44.0))
        # A ray crosses a closed outline twice and a thin line once; both transmit the same in total.
        transmission = (_BUILDING_TRANSMISSION if straight else _VEGETATION_TRANSMISSION) ** (
            0.5 if len(sides) == len(outline) else 1.0
        )
        counts = rng.poisson(lengths / rng.uniform(2.0, 8.0))
        chosen = np.repeat(np.arange(len(sides)), counts)
        along = rng.random((len(chosen), 1))
        points = (1.0 - along) * sides[chosen, 0] + along * sides[chosen, 1]
        powers = _from_decibels(min(decibels, 54.0) - rng.uniform(4.0, 22.0, len(chosen)))
        wall_powers, transmissions = np.full(len(sides), 10.0 ** (decibels / 10.0)), np.full(len(sides), transmission)
        found[straight].append(Reflectors(sides, wall_powers, transmissions, points, powers))
    return concatenate(*found[True]), concatenate(*found[False])


def _sides(outline: Array) -> Array:
    """(W, 2, 2) distinct sides of a closed outline: that of a thin object has each side in both directions."""
    following = np.roll(outline, -1, axis=0)
    undirected = np.where(
        _before(outline, following)[:, None], np.hstack([outline, following]), np.hstack([following, outline])
    )
    distinct = np.unique(undirected, axis=0)
    distinct = distinct[np.any(distinct[:, :2] != distinct[:, 2:], axis=1)]
    return distinct.reshape(-1, 2, 2)


def _is_straight(outline: Array) -> bool:
    coarse = cv2.approxPolyDP(outline.astype(np.float32)[:, None], _COARSE_M, True)[:, 0]
    lengths = np.hypot(*(np.roll(coarse, -1, axis=0) - coarse).T)
    return bool(np.sum(lengths**2) > _STRAIGHT_M * np.sum(lengths))


def _before(points: Array, others: Array) -> NDArray[np.bool_]:
    return np.asarray((points[:, 0] < others[:, 0]) | ((points[:, 0] == others[:, 0]) & (points[:, 1] < others[:, 1])))


def _from_decibels(decibels: Array) -> Array:
    return np.asarray(10.0 ** (decibels / 10.0))
