"""Simulated training drives of one city share its streets."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.lab.training.config import DataConfig
from offradar_ros.lab.training.simulated_drives import simulated_drives


def test_simulated_drives_of_a_world_meet_in_both_directions() -> None:
    config = DataConfig(worlds=1, first_seed=5, drives=3, scans=40, spacing_m=6.0, degraded=0.25, bad_weather=0.0)
    opened = [source.open() for source in simulated_drives(config)]
    assert [len(drive) for drive in opened] == [40] * 3
    spacing_m = np.linalg.norm(np.diff(opened[0].poses[:, :2], axis=0), axis=1)
    assert spacing_m.mean() == pytest.approx(6.0, rel=0.35)
    for other in opened[1:]:
        distance_m = np.linalg.norm(opened[0].poses[:, None, :2] - other.poses[None, :, :2], axis=-1).min(axis=1)
        assert (distance_m < 15.0).mean() > 0.7
    turn = np.cos(opened[0].poses[20, 2] - opened[1].poses[20, 2])
    assert turn > 0.5
    back = np.linalg.norm(opened[2].poses[:, :2] - opened[0].poses[20, :2], axis=1).argmin()
    assert np.cos(opened[0].poses[20, 2] - opened[2].poses[back, 2]) < -0.5
    assert sum(kind != '' for kind in opened[0].kinds) == pytest.approx(10, abs=7)


def test_drives_of_a_world_are_in_different_seasons() -> None:
    plans = [source.plan for source in simulated_drives(DataConfig(worlds=10, drives=4))]
    foliage = np.array([plan.foliage for plan in plans])
    assert 0.1 < (foliage == 0.0).mean() < 0.45 and 0.1 < (foliage == 1.0).mean() < 0.45
    assert len({plan.foliage for plan in plans[:4]}) > 1
    assert foliage.tolist() == [source.plan.foliage for source in simulated_drives(DataConfig(worlds=10, drives=4))]


def test_drives_of_a_world_take_its_radars_in_turn() -> None:
    one, two = (
        [source.plan.physics for source in simulated_drives(DataConfig(worlds=2, drives=4, radars=radars))]
        for radars in (1, 2)
    )
    assert one[0] == one[1] == one[2] != one[4]
    assert two[0] == two[2] == one[0]
    assert two[1] == two[3] != two[0]
    assert len(set(two)) == 4
    streets = [source.open().poses[:, :2] for source in simulated_drives(DataConfig(worlds=1, drives=2, radars=2))]
    assert np.linalg.norm(streets[0][0] - streets[1][0]) < 15.0
