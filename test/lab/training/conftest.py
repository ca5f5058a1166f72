"""Cached drives made up in memory: patterns of reflectors that belong to places, under speckle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.training.cache import CachedDrive

AZIMUTHS = 48
BINS = 64


def pattern_drive(
    name: str,
    places: int = 8,
    spacing_m: float = 60.0,
    lane_m: float = 0.0,
    world: str = 'w',
    degraded: tuple[int, ...] = (),
    speckle: float = 8.0,
) -> CachedDrive:
    """One scan a place, at x = spacing · place; places look alike only to themselves, whatever the drive."""
    noise = np.random.default_rng([*name.encode()])
    power = np.empty((places, AZIMUTHS, BINS), np.uint8)
    for place in range(places):
        pattern = (np.random.default_rng([place, *world.encode()]).random((AZIMUTHS, BINS)) < 0.06) * 200.0
        if place in degraded:
            pattern *= 0.1
        power[place] = np.minimum(pattern + noise.gamma(1.0, speckle, pattern.shape), 255)
    poses = np.column_stack([spacing_m * np.arange(places), np.full(places, lane_m), np.zeros(places)])
    return CachedDrive(
        name=name,
        world=world,
        power=power,
        azimuths_rad=np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS),
        range_resolution_m=1.0,
        range_offset_m=0.0,
        poses=poses,
        kinds=tuple('flooded' if place in degraded else '' for place in range(places)),
        severities=np.array([0.9 * (place in degraded) for place in range(places)], np.float32),
    )


@pytest.fixture(scope='session')
def make_drive() -> Callable[..., CachedDrive]:
    return pattern_drive


def line_drive(name: str, world: str, positions_m: NDArray[np.float64], degraded: NDArray[np.bool_]) -> CachedDrive:
    """A drive of which only positions and faults matter."""
    count = len(positions_m)
    return CachedDrive(
        name=name,
        world=world,
        power=np.ones((count, 8, 4), np.uint8),
        azimuths_rad=np.arange(8) * (np.pi / 4),
        range_resolution_m=1.0,
        range_offset_m=0.0,
        poses=np.column_stack([positions_m, np.zeros(count)]),
        kinds=tuple('blocked' if fault else '' for fault in degraded),
        severities=degraded.astype(np.float32),
    )


@pytest.fixture(scope='session')
def make_line() -> Callable[..., CachedDrive]:
    return line_drive
