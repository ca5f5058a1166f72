"""Rays and walls, compared with every ray on every wall."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.simulation.rays import DEPTH, cast_rays
from offradar_ros.lab.simulation.reflectors import Reflectors

AZIMUTHS = 90
Array = NDArray[np.float64]


def reflectors(walls: ArrayLike, transmission: Sequence[float] | Array) -> Reflectors:
    empty = np.empty((0, 2))
    return Reflectors(
        np.asarray(walls, float), np.ones(len(transmission)), np.asarray(transmission, float), empty, np.empty(0)
    )


def all_hits(walls: Array, poses: Array, max_range_m: float) -> list[tuple[int, int, float]]:
    """Row, wall and range of every hit, one ray and one wall at a time, by linear equations."""
    found = []
    for row, (x, y, heading) in enumerate(poses):
        angle = heading - row * 2 * np.pi / len(poses)
        for wall, ((x1, y1), (x2, y2)) in enumerate(walls):
            matrix = np.array([[np.cos(angle), x1 - x2], [np.sin(angle), y1 - y2]])
            if abs(np.linalg.det(matrix)) > 1e-12:
                range_m, fraction = np.linalg.solve(matrix, (x1 - x, y1 - y))
                if 0.5 < range_m < max_range_m and 0.0 <= fraction <= 1.0:
                    found.append((row, wall, float(range_m)))
    return found


@pytest.mark.parametrize('seed', range(8))
def test_all_hits_are_found_while_the_radar_moves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    middles, headings = rng.uniform(-40.0, 40.0, (30, 2)), rng.uniform(0.0, np.pi, 30)
    half = rng.uniform(1.0, 25.0, 30)[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    walls = np.stack([middles - half, middles + half], axis=1)
    along = np.linspace(0.0, 1.0, AZIMUTHS)
    poses = np.stack([500.0 + 6.0 * along, -200.0 + 2.0 * along, 3.0 + 0.4 * along], axis=1)
    walls += np.array([503.0, -199.0])
    hits = cast_rays(reflectors(walls, np.full(30, 0.5)), poses, 45.0)
    expected = all_hits(walls, poses, 45.0)
    ranges = {(row, wall): range_m for row, wall, range_m in expected}
    for row, wall, range_m in zip(hits.rows, hits.walls, hits.range_m, strict=True):
        assert ranges[row, wall] == pytest.approx(range_m)
    for row in range(AZIMUTHS):
        of_row = sorted(range_m for r, _, range_m in expected if r == row)
        np.testing.assert_allclose(hits.range_m[hits.rows == row], of_row[:DEPTH])


def test_transmissions_of_walls_multiply() -> None:
    walls = [((x, -5.0), (x, 5.0)) for x in (10.0, 20.0, 30.0)]
    hits = cast_rays(reflectors(walls, [0.5, 0.1, 0.9]), np.zeros((AZIMUTHS, 3)), 100.0)
    ahead = hits.rows == 0
    np.testing.assert_allclose(hits.transmission[ahead], [1.0, 0.5, 0.05])
    np.testing.assert_allclose(hits.cosine[ahead], 1.0)
    rows = np.zeros(5, np.intp)
    np.testing.assert_allclose(
        hits.transmission_at(rows, np.array([5.0, 15.0, 25.0, 35.0, 95.0])), [1.0, 0.5, 0.05, 0.045, 0.045]
    )
    np.testing.assert_allclose(hits.transmission_at(rows + AZIMUTHS // 2, np.full(5, 99.0)), 1.0)
    squared = cast_rays(reflectors(walls, [0.5, 0.1, 0.9]), np.zeros((AZIMUTHS, 3)), 100.0, occlusion=2.0)
    np.testing.assert_allclose(squared.transmission[ahead], [1.0, 0.25, 0.0025])


def test_a_world_without_walls() -> None:
    hits = cast_rays(reflectors(np.empty((0, 2, 2)), []), np.zeros((AZIMUTHS, 3)), 50.0)
    assert not len(hits.rows) and np.all(np.isinf(hits.wall_ranges_m)) and np.all(hits.transmission_behind == 1.0)


def test_within_keeps_all_reflectors_in_range() -> None:
    rng = np.random.default_rng(3)
    walls = rng.uniform(-100.0, 100.0, (400, 2, 2))
    points = rng.uniform(-100.0, 100.0, (400, 2))
    everything = Reflectors(walls, np.arange(400.0), np.ones(400), points, np.arange(400.0))
    centre, range_m = np.array([20.0, -10.0]), 35.0
    near = everything.within(centre, range_m)
    steps = np.linspace(0.0, 1.0, 200)[:, None, None]
    distance = np.linalg.norm(walls[:, 0] + steps * (walls[:, 1] - walls[:, 0]) - centre, axis=2).min(axis=0)
    assert set(np.flatnonzero(distance < range_m)) <= set(near.wall_powers.astype(int))
    assert set(np.flatnonzero(np.linalg.norm(points - centre, axis=1) < range_m)) <= set(near.scatterer_powers)
    assert len(near.scatterers_m) < 100
