"""Radars for training and held-out radars."""

from __future__ import annotations

import dataclasses

import pytest

from offradar_ros.lab.simulation.physics import (
    HELD_OUT_RANGES,
    NOMINAL_PHYSICS,
    TRAINED_RANGES,
    UNSEEN_RANGES,
    RadarPhysics,
    SpeckleLaw,
    draw_physics,
    held_out_physics,
    unseen_physics,
)


def numbers(physics: RadarPhysics) -> dict[str, float]:
    return {name: value for name, value in dataclasses.asdict(physics).items() if isinstance(value, float)}


def test_every_number_is_drawn_and_the_nominal_radar_is_within_all_ranges() -> None:
    assert set(TRAINED_RANGES) | {'ceiling'} == set(numbers(NOMINAL_PHYSICS))
    for name, (low, high) in TRAINED_RANGES.items():
        assert low < high
        assert low <= getattr(NOMINAL_PHYSICS, name) <= high, name
    assert NOMINAL_PHYSICS.speckle is SpeckleLaw.RAYLEIGH


def test_the_same_seed_draws_the_same_radar() -> None:
    assert draw_physics(3) == draw_physics(3) != draw_physics(4)
    assert held_out_physics(3) == held_out_physics(3) != held_out_physics(4)
    assert unseen_physics(3) == unseen_physics(3) != unseen_physics(4)


def test_draws_cover_their_ranges() -> None:
    drawn = [draw_physics(seed) for seed in range(200)]
    for name, (low, high) in TRAINED_RANGES.items():
        values = [getattr(physics, name) for physics in drawn]
        assert low <= min(values) < low + 0.1 * (high - low) and high - 0.1 * (high - low) < max(values) <= high
    assert all(physics.knee < physics.ceiling <= 200.0 for physics in drawn)
    assert {physics.integer_powers for physics in drawn} == {True, False}


OUTSIDE = [(name, *bounds) for ranges in (HELD_OUT_RANGES, UNSEEN_RANGES) for name, bounds in sorted(ranges.items())]


@pytest.mark.parametrize(('name', 'low', 'high'), OUTSIDE)
def test_held_out_and_unseen_ranges_do_not_overlap_those_of_training(name: str, low: float, high: float) -> None:
    trained_low, trained_high = TRAINED_RANGES[name]
    assert low > trained_high or high < trained_low


def test_no_held_out_radar_can_be_drawn_for_training() -> None:
    for seed in range(100):
        trained, held_out = draw_physics(seed), held_out_physics(seed)
        assert trained.speckle is SpeckleLaw.RAYLEIGH is not held_out.speckle
        for name, (low, high) in HELD_OUT_RANGES.items():
            assert low <= getattr(held_out, name) <= high
            assert not low <= getattr(trained, name) <= high
    assert {held_out_physics(seed).speckle for seed in range(20)} == {SpeckleLaw.LOG_NORMAL, SpeckleLaw.K}


def test_no_unseen_radar_can_be_drawn_for_training_or_validation() -> None:
    for seed in range(100):
        trained, held_out, unseen = draw_physics(seed), held_out_physics(seed), unseen_physics(seed)
        assert unseen.speckle is SpeckleLaw.WEIBULL not in {trained.speckle, held_out.speckle}
        for name, (low, high) in UNSEEN_RANGES.items():
            assert low <= getattr(unseen, name) <= high
            assert not low <= getattr(trained, name) <= high
        assert any(not low <= getattr(held_out, name) <= high for name, (low, high) in UNSEEN_RANGES.items())
