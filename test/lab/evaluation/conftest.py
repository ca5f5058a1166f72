"""Drives that need no simulation: poses along a street, and descriptors made for the test."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.protocol import Group, Lane, Protocol, Validation
from offradar_ros.types import PolarScan


def street_drive(index: int, count: int, *, seed: int = 0, spoiled: float = 0.4, noise: float = 0.4) -> EmbeddedDrive:
    """Scans 4 m apart; the descriptor is the place's, and noise that grows with a severity that U follows."""
    rng = np.random.default_rng([seed, index])
    driven_m = 4.0 * np.arange(count)
    bad = rng.random(count) < spoiled
    severities = np.where(bad, rng.uniform(0.05, 1.0, count), 0.0)
    kinds = np.where(bad, rng.choice(['blocked', 'flooded'], count), '')
    waves = np.random.default_rng(5).uniform(0.01, 0.2, 24)
    places = np.cos(driven_m[:, None] * waves)
    means = places + rng.normal(0.0, 1.0, places.shape) * (0.05 + noise * severities[:, None] * 4.0)
    poses = np.column_stack([driven_m, np.full(count, 1.0 * index), np.zeros(count)])
    power = np.random.default_rng(index).integers(0, 90, (count, 40, 64), np.uint8)
    azimuths_rad = np.arange(40) / 40 * 2 * np.pi
    drive = Drive(
        name=f'street_{index + 1}',
        group='streets',
        world='street',
        index=index,
        key=f'street_{index}_{seed}',
        stamps_ns=np.arange(count, dtype=np.int64) * 10**9 + index * 10**14,
        poses=poses,
        driven_m=driven_m,
        kinds=kinds,
        severities=severities,
        read_scan=lambda row: PolarScan(row * 10**9 + index * 10**14, power[row], azimuths_rad, 1.0),
    )
    uncertainties = 0.3 + severities + rng.normal(0.0, 0.05, count)
    return EmbeddedDrive(drive, means.astype(np.float32), uncertainties)


@pytest.fixture(scope='session')
def embedded_street() -> Callable[..., EmbeddedDrive]:
    return street_drive


@pytest.fixture(scope='session')
def small_protocol() -> Protocol:
    return Protocol(
        name='small',
        title='One street',
        groups=(Group('streets', 'a street', 'drawn', cities=(7,)),),
        lanes=(Lane(), Lane(1.0), Lane(-1.0)),
        validation=Validation((8,)),
        resamples=20,
    )
