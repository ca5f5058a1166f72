"""Vegetation in leaf and bare."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from offradar_ros.errors import ConfigError
from offradar_ros.lab.simulation.city import CityPlan, District, make_city
from offradar_ros.lab.simulation.foliage import in_season
from offradar_ros.lab.simulation.reflectors import concatenate
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.traversal import Traversal
from offradar_ros.lab.simulation.world import World


@pytest.fixture(scope='module')
def park() -> World:
    return make_city(CityPlan(seed=2, blocks=(2, 2), route_m=400.0, districts=(District.PARK,)))


def test_in_leaf_nothing_changes(park: World) -> None:
    for before, after in zip(
        dataclasses.astuple(park.vegetation), dataclasses.astuple(in_season(park.vegetation, 1.0)), strict=True
    ):
        np.testing.assert_array_equal(before, after)


def test_bare_vegetation_returns_several_decibels_less_and_hides_less(park: World) -> None:
    green = park.vegetation
    assert len(green.wall_powers) > 50 and len(green.scatterer_powers) > 500
    half, bare = in_season(green, 0.5), in_season(green, 0.0)
    for name in ('wall_powers', 'scatterer_powers'):
        lost_db = 10.0 * np.log10(getattr(green, name) / getattr(bare, name))
        assert lost_db.min() > 4.0 and lost_db.max() < 12.0
        assert np.all(getattr(half, name) < getattr(green, name)) and np.all(getattr(half, name) > getattr(bare, name))
    assert np.all(bare.wall_transmission > half.wall_transmission) and np.all(bare.wall_transmission < 1.0)
    assert np.all(half.wall_transmission > green.wall_transmission)
    np.testing.assert_array_equal(bare.walls_m, green.walls_m)


def test_a_drive_in_winter_passes_bare_trees_and_the_same_walls_and_poles(park: World) -> None:
    def powers(foliage: float) -> tuple[float, float]:
        drive = Traversal(SessionPlan(foliage=foliage, traffic=0.0, parked=0.0), park, 10.0)
        seen = drive.reflectors_at(0.0, 400.0)
        return float(seen.scatterer_powers.sum()), float(seen.wall_powers.sum())

    (summer_points, summer_walls), (winter_points, winter_walls) = powers(1.0), powers(0.0)
    everything = concatenate(park.reflectors, park.vegetation)
    assert summer_points == pytest.approx(everything.scatterer_powers.sum(), rel=0.7)
    assert winter_points < summer_points and winter_walls < summer_walls


def test_trunks_poles_and_buildings_are_hard_in_every_season(park: World) -> None:
    """A tree has one hard return, its trunk, among its leaves."""
    assert park.reflectors.scatterer_powers.max() > park.vegetation.scatterer_powers.max()
    assert park.vegetation.wall_transmission.min() > 0.3


@pytest.mark.parametrize('foliage', [-0.1, 1.5])
def test_foliage_out_of_bounds_is_refused(foliage: float) -> None:
    with pytest.raises(ConfigError, match=r'foliage of a simulated drive: expected 0\.0 to 1\.0'):
        SessionPlan(foliage=foliage)
