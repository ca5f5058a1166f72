"""Half of the road is left out of each map, and places of other worlds are never right."""

from __future__ import annotations

import dataclasses

import numpy as np
from street_evaluation import street_drive

from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.open_set import OpenSet, open_sets, other_roads

TOLERANCE_M, SPACING_M = 25.0, 8.0
COUNT = 60


def drives() -> list[EmbeddedDrive]:
    return [street_drive(index, COUNT) for index in (0, 1)]


def sets(*, with_others: bool = False) -> list[OpenSet]:
    others = other_roads([[street_drive(2, COUNT, seed=9), street_drive(3, COUNT, seed=9)]], SPACING_M)
    return list(open_sets(drives(), SPACING_M, TOLERANCE_M, others if with_others else None))


def test_each_pair_of_drives_is_searched_with_either_half_left_out() -> None:
    found = sets()
    assert len(found) == 4
    middle_m, at_m = 4.0 * (COUNT - 1) / 2.0, 4.0 * np.arange(COUNT)
    for number, one in enumerate(found):
        assert len(one.evidence) == COUNT
        assert one.places == COUNT // 4
        off_map_m = at_m - middle_m if number % 2 == 0 else middle_m - at_m
        assert one.on_map[off_map_m < 0.0].all()
        assert not one.on_map[off_map_m > TOLERANCE_M + SPACING_M].any()
        assert not one.right[~one.on_map].any()
        assert one.right.any()
        assert set(one.degraded.tolist()) == {True, False}


def test_scans_that_the_encoder_refused_are_no_queries() -> None:
    mapped, query = drives()
    uncertainties = query.uncertainties.copy()
    uncertainties[3] = np.inf
    refused = dataclasses.replace(query, uncertainties=uncertainties)
    assert {len(one.evidence) for one in open_sets([mapped, refused], SPACING_M, TOLERANCE_M)} == {COUNT, COUNT - 1}


def test_added_places_are_elsewhere_and_never_right() -> None:
    for alone, together in zip(sets(), sets(with_others=True), strict=True):
        assert together.places == alone.places + COUNT
        np.testing.assert_array_equal(together.on_map, alone.on_map)
        assert not (together.right & ~alone.on_map).any()
        assert (together.evidence.distance <= alone.evidence.distance).all()
        assert np.isfinite(together.evidence.distance_apart).all()


def test_drives_of_one_added_world_share_its_frame() -> None:
    one_world = other_roads([[street_drive(0, COUNT), street_drive(1, COUNT)]], SPACING_M)
    two_worlds = other_roads([[street_drive(0, COUNT)], [street_drive(1, COUNT)]], SPACING_M)
    assert np.ptp(one_world.positions_m[:, 0]) < 4.0 * COUNT
    assert np.ptp(two_worlds.positions_m[:, 0]) > 1e5
