from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from encoded_streets import encoded_street

from offradar_ros.calibration.encoded_drive import EncodedDrive
from offradar_ros.calibration.sensor_shift import shifted, typical_distance
from offradar_ros.config import ConfidenceConfig
from offradar_ros.retrieval.confidence import probability
from offradar_ros.types import Evidence


def drive(count: int) -> EncodedDrive:
    """A scan every 5 m."""
    made = encoded_street(0, count)
    along_m = 5.0 * np.arange(count, dtype=np.float64)
    return dataclasses.replace(made, driven_m=along_m, poses=np.column_stack([along_m, *np.zeros((2, count))]))


def test_it_is_the_median_distance_to_the_nearest_place_elsewhere_as_in_a_loop() -> None:
    made = drive(200)
    found = typical_distance(made, 25.0)
    apart = []
    for half in (np.arange(100), np.arange(100, 200)):
        for scan in range(200):
            distances = np.linalg.norm(made.means[half] - made.means[scan], axis=1)
            nearest_m = made.poses[half[np.argmin(distances)], 0]
            apart.append(distances[np.abs(made.poses[half, 0] - nearest_m) > 25.0].min())
    assert found == pytest.approx(np.median(apart), rel=1e-5)


def test_a_longer_road_has_no_other_distance_and_a_short_one_has_none() -> None:
    made = drive(800)
    twice = typical_distance(made, 25.0)
    first = typical_distance(drive(200), 25.0)
    assert first is not None
    assert twice == pytest.approx(first, rel=0.15)
    assert typical_distance(drive(199), 25.0) is None


def test_descriptors_at_another_scale_have_the_same_probability() -> None:
    shipped = ConfidenceConfig(
        intercept=3.0, distance=-6.0, spatial_ratio=-5.0, place_ratio=-4.0, unrelated_distance=0.9
    )
    evidence = Evidence(0.3, 0.6, 0.7, 1.2, 1.1)
    smaller = Evidence(0.15, 0.3, 0.35, 1.2, 1.1)
    there = probability(smaller, shifted(shipped, 1.0, 0.45))
    assert there == pytest.approx(probability(evidence, shipped), abs=1e-12)
    assert there < probability(smaller, shipped)
    assert shifted(shipped, 1.0, None) == shipped
