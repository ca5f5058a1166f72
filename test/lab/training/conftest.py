"""Drives in memory: a pattern of reflectors for each place, with speckle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.types import PolarScan

AZIMUTHS = 48
BINS = 64


def drive_of(
    name: str,
    world: str,
    power: NDArray[np.uint8],
    poses: NDArray[np.float64],
    kinds: NDArray[np.str_],
    severities: NDArray[np.float64],
) -> Drive:
    azimuths_rad = np.linspace(0.0, 2 * np.pi, power.shape[1], endpoint=False)
    return Drive(
        name=name,
        world=world,
        key=name,
        stamps_ns=np.arange(len(power), dtype=np.int64),
        poses=poses,
        driven_m=np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))]),
        kinds=kinds,
        severities=severities,
        read_scan=lambda row: PolarScan(row, power[row], azimuths_rad, 1.0),
    )


def pattern_drive(
    name: str,
    places: int = 8,
    spacing_m: float = 60.0,
    lane_m: float = 0.0,
    world: str = 'w',
    degraded: tuple[int, ...] = (),
    speckle: float = 8.0,
) -> Drive:
    """One scan per place, at x = spacing · place; the pattern of a place is the same in all drives of a world."""
    noise = np.random.default_rng([*name.encode()])
    power = np.empty((places, AZIMUTHS, BINS), np.uint8)
    for place in range(places):
        pattern = (np.random.default_rng([place, *world.encode()]).random((AZIMUTHS, BINS)) < 0.06) * 200.0
        if place in degraded:
            pattern *= 0.1
        power[place] = np.minimum(pattern + noise.gamma(1.0, speckle, pattern.shape), 255)
    poses = np.column_stack([spacing_m * np.arange(places), np.full(places, lane_m), np.zeros(places)])
    faults = np.isin(np.arange(places), degraded)
    return drive_of(name, world, power, poses, np.where(faults, 'flooded', ''), np.where(faults, 0.9, 0.0))


@pytest.fixture(scope='session')
def make_drive() -> Callable[..., Drive]:
    return pattern_drive


def line_drive(name: str, world: str, positions_m: NDArray[np.float64], degraded: NDArray[np.bool_]) -> Drive:
    """A drive with positions and faults, and scans without content."""
    count = len(positions_m)
    poses = np.column_stack([positions_m, np.zeros(count)])
    kinds = np.where(degraded, 'blocked', '')
    return drive_of(name, world, np.ones((count, 8, 4), np.uint8), poses, kinds, degraded.astype(np.float64))


@pytest.fixture(scope='session')
def make_line() -> Callable[..., Drive]:
    return line_drive
