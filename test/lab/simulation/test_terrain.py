"""What the ground returns."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS, RadarPhysics
from offradar_ros.lab.simulation.rays import cast_rays
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.terrain import Terrain

AZIMUTHS, CELLS, CELL_M = 200, 400, 0.4
FLAT = dataclasses.replace(NOMINAL_PHYSICS, ground_patch_db=0.0, slope_share=0.0)
SLOPES = dataclasses.replace(FLAT, slope_db=15.0, slope_share=0.15)


def ground(
    physics: RadarPhysics, x: float = 0.0, y: float = 0.0, heading: float = 0.0, seed: int = 1, wall_m: float = 0.0
) -> NDArray[np.float32]:
    walls = np.array([[(wall_m, -500.0), (wall_m, 500.0)]]) if wall_m else np.empty((0, 2, 2))
    near = Reflectors(walls, np.ones(len(walls)), np.full(len(walls), 0.25), np.empty((0, 2)), np.empty(0))
    poses = np.tile([x, y, heading], (AZIMUTHS, 1))
    return Terrain(AZIMUTHS, CELLS, CELL_M, physics, seed).power(cast_rays(near, poses, CELLS * CELL_M), poses)


def test_flat_ground_returns_the_same_everywhere() -> None:
    assert ground(FLAT) == pytest.approx(1.0)


def test_patches_have_mean_one_in_the_long_run() -> None:
    patchy = dataclasses.replace(FLAT, ground_patch_db=4.0)
    found = np.array([ground(patchy, x=300.0 * k).mean() for k in range(20)])
    assert found.mean() == pytest.approx(1.0, abs=0.15)
    assert found.std() > 0.0


def test_slopes_cover_their_share_and_are_as_strong_as_stated() -> None:
    found = np.concatenate([ground(SLOPES, x=300.0 * k, y=170.0 * k)[:, 40:].ravel() for k in range(12)])
    assert np.mean(found > 1.05) == pytest.approx(0.15, abs=0.05)
    assert found.max() > 30.0
    assert found.min() >= 1.0 - 1e-6


def test_a_slope_is_seen_from_below_and_not_from_above() -> None:
    """From the other side of a hill, at the same point of the world, the ground falls along the ray."""
    here, there = ground(SLOPES), ground(SLOPES, x=120.0, heading=np.pi)
    forward = here[0, :300]
    backward = there[0, :300][::-1]
    assert np.any(forward > 3.0) or np.any(backward > 3.0)
    assert not np.any((forward > 2.0) & (backward > 2.0))


def test_the_ground_is_fixed_in_the_world_and_differs_between_worlds() -> None:
    turned = ground(SLOPES, heading=np.pi / 2)
    assert np.roll(turned, -AZIMUTHS // 4, axis=0) == pytest.approx(ground(SLOPES), rel=0.02, abs=0.2)
    assert np.abs(ground(SLOPES, seed=2) - ground(SLOPES)).max() > 3.0


def test_a_wall_weakens_the_ground_behind_it() -> None:
    found = ground(FLAT, wall_m=40.0)
    assert found[0, :96] == pytest.approx(1.0)
    assert found[0, 110:] == pytest.approx(0.25)
    assert found[AZIMUTHS // 2] == pytest.approx(1.0)
