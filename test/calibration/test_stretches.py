from __future__ import annotations

import numpy as np

from offradar_ros.calibration.stretches import squares, stretches


def test_the_parts_are_equally_full_and_each_is_one_piece_of_a_straight_road() -> None:
    along = np.random.default_rng(0).uniform(0.0, 4000.0, 800)
    found = stretches(np.column_stack([along, 0.01 * along]), 3)
    assert np.bincount(found).tolist() == [100] * 8
    assert (np.diff(found[np.argsort(along)]) >= 0).all()


def test_drives_share_the_parts() -> None:
    road = np.random.default_rng(1).uniform(0.0, 900.0, (300, 2))
    found = stretches(np.concatenate([road, road[::-1] + 0.001]), 3)
    assert np.mean(found[:300] == found[300:][::-1]) > 0.98


def test_no_or_few_positions_have_parts_too() -> None:
    assert len(stretches(np.empty((0, 2)), 3)) == 0
    assert set(stretches(np.zeros((5, 2)), 3).tolist()) == {0}


def test_squares_are_of_ground() -> None:
    positions = np.array([[1.0, 1.0], [99.0, 99.0], [101.0, 1.0], [-1.0, 1.0], [2.0, 3.0]])
    found = squares(positions)
    assert found[0] == found[1] == found[4]
    assert len(set(found.tolist())) == 3
