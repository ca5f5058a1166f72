"""The scatter of the nearest places against a loop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from offradar_ros.lab.evaluation.spatial_uncertainty import STEEPNESS, spatial_variance


def slow_variance(distances: list[float], places_m: list[tuple[float, float]]) -> float:
    weights = [math.exp(-STEEPNESS * (d - distances[0]) / distances[0]) for d in distances]
    total = 0.0
    for axis in (0, 1):
        mean = sum(w * place[axis] for w, place in zip(weights, places_m, strict=True)) / sum(weights)
        for weight, place in zip(weights, places_m, strict=True):
            total += weight / sum(weights) * min(abs(place[axis] - mean), 500.0) ** 2
    return total / 2.0


def test_the_variance_against_a_loop() -> None:
    rng = np.random.default_rng(1)
    distances = np.sort(rng.uniform(0.2, 0.4, (20, 5)), axis=1)
    places_m = rng.normal(0.0, 400.0, (20, 5, 2))
    found = spatial_variance(distances, places_m)
    for row in range(20):
        expected = slow_variance(distances[row].tolist(), [tuple(place) for place in places_m[row].tolist()])
        assert found[row] == pytest.approx(expected)


def test_missing_places_and_exact_matches_count() -> None:
    places_m = np.array([[[0.0, 0.0], [60.0, 0.0], [9e9, 9e9]]])
    found = spatial_variance(np.array([[0.5, 0.5, np.inf]]), places_m)
    assert found[0] == pytest.approx(30.0**2 / 2.0)
    assert spatial_variance(np.array([[0.0, 0.5, np.inf]]), places_m)[0] == 0.0
