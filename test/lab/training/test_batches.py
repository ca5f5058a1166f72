"""Batches, checked pair by pair in plain loops."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip('torch')

from offradar_ros.errors import DataError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.batches import BatchSampler
from offradar_ros.lab.training.config import BatchConfig

MakeLine = Callable[..., Drive]


def worlds(make_line: MakeLine, seed: int = 0) -> list[Drive]:
    """Three worlds of two drives each, about 600 m long, with a third of the scans degraded."""
    rng = np.random.default_rng(seed)
    drives = []
    for world in 'abc':
        line = np.cumsum(rng.normal((4.0, 0.0), 2.0, (150, 2)), axis=0)
        for lane in range(2):
            drives.append(
                make_line(f'{world}{lane}', world, line + np.array([0.0, 4.0 * lane]), rng.random(150) < 0.33)
            )
    return drives


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), step=st.integers(0, 10**9), places=st.integers(2, 12))
def test_views_of_a_place_are_near_and_of_two_places_far(
    make_line: MakeLine, seed: int, step: int, places: int
) -> None:
    sampler = BatchSampler(worlds(make_line), BatchConfig(places=places), seed)
    batch = sampler.batch(step)
    assert batch.scans.shape == batch.spins.shape == (2 * places,)
    for i in range(2 * places):
        for j in range(i):
            a, b = batch.scans[i], batch.scans[j]
            assert a != b
            same_world = sampler.world_of[a] == sampler.world_of[b]
            distance_m = math.dist(sampler.positions_m[a], sampler.positions_m[b])
            if i - j == places:
                assert same_world
                assert distance_m <= 20.0
            else:
                assert not same_world or distance_m > 50.0


def test_a_batch_depends_on_seed_rank_and_step_alone(make_line: MakeLine) -> None:
    drives = worlds(make_line)
    one, another = (BatchSampler(drives, BatchConfig(places=6), 3) for _ in range(2))
    for step in range(5):
        one.batch(step)
    assert all(np.array_equal(a, b) for a, b in zip(one.batch(7), another.batch(7), strict=True))
    assert not np.array_equal(one.batch(7).scans, one.batch(8).scans)
    assert not np.array_equal(one.batch(7).scans, BatchSampler(drives, BatchConfig(places=6), 4).batch(7).scans)
    assert not np.array_equal(one.batch(7).scans, BatchSampler(drives, BatchConfig(places=6), 3, 1).batch(7).scans)


@pytest.mark.parametrize('share', [0.0, 0.35, 1.0])
def test_the_share_of_degraded_views_is_that_of_the_configuration(make_line: MakeLine, share: float) -> None:
    sampler = BatchSampler(worlds(make_line), BatchConfig(places=8, degraded_views=share), 1)
    pairs = np.concatenate([sampler.batch(step).scans.reshape(2, 8) for step in range(60)], axis=1)
    is_degraded = np.array([sampler.kinds[scan] != '' for scan in pairs.ravel()]).reshape(pairs.shape)
    assert is_degraded.mean() == pytest.approx(share, abs=0.05)
    assert (is_degraded[0] & ~is_degraded[1]).mean() == pytest.approx(share * (1 - share), abs=0.05)


def test_neighbours_in_time_are_of_one_drive(make_line: MakeLine) -> None:
    sampler = BatchSampler(worlds(make_line), BatchConfig(places=6, positive='time', positive_scans=2), 1)
    for step in range(20):
        first, second = sampler.batch(step).scans.reshape(2, 6)
        assert np.array_equal(sampler.drive_of[first], sampler.drive_of[second])
        steps = np.abs(sampler.row_of[first] - sampler.row_of[second])
        assert ((steps == 1) | (steps == 2)).all()


def test_views_are_rotated_by_any_number_of_azimuths_or_not_at_all(make_line: MakeLine) -> None:
    drives = worlds(make_line)
    spins = np.concatenate([BatchSampler(drives, BatchConfig(places=8), 1).batch(step).spins for step in range(20)])
    assert set(spins.tolist()) == set(range(8))
    unrotated = BatchSampler(drives, BatchConfig(places=8, spin=False), 1).batch(0).spins
    assert not unrotated.any()


def test_too_few_places_are_reported(make_line: MakeLine) -> None:
    drive = make_line('a', 'w', np.column_stack([np.linspace(0, 120, 30), np.zeros(30)]), np.zeros(30, bool))
    with pytest.raises(DataError, match=r'30 scans of 1 worlds: expected fewer batch.places or more data'):
        BatchSampler([drive], BatchConfig(places=4), 1).batch(0)
    with pytest.raises(DataError, match=r'expected data.worlds, data.sequences or data.split'):
        BatchSampler([], BatchConfig(), 1)


def test_a_batch_is_drawn_from_the_configured_number_of_worlds(make_line: MakeLine) -> None:
    sampler = BatchSampler(worlds(make_line), BatchConfig(places=4, worlds=2), 1)
    drawn = [frozenset(sampler.world_of[sampler.batch(step).scans].tolist()) for step in range(30)]
    assert all(len(found) <= 2 for found in drawn)
    assert frozenset().union(*drawn) == {0, 1, 2}
