from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.calibration.road import ErrorLimit, calibrate_road
from offradar_ros.config import load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError
from offradar_ros.recordings.road import PositionedDrive, open_road

LIMIT = ErrorLimit(0.3, 0.75)
RING_KEY = load_config(overrides={'encoder.name': 'ring_key'})


@pytest.fixture
def drives(street_bag: Callable[..., Path]) -> list[PositionedDrive]:
    paths = [street_bag(f'drive_{i}', count=12 + i, lane_m=1.0 * i, noise_seed=i) for i in range(2)]
    return open_road(paths).drives


def test_scale_and_progress_are_over_all_drives(drives: list[PositionedDrive]) -> None:
    reported: list[tuple[int, int]] = []
    calibration, choice = calibrate_road(drives, RING_KEY, LIMIT, lambda done, total: reported.append((done, total)))
    encoder = make_encoder(load_config(overrides=calibration.values).encoder)
    uncertainties = [encoder.encode(drive.scan(i)).uncertainty for drive in drives for i in range(len(drive))]
    assert np.mean(uncertainties) == pytest.approx(1.0, abs=1e-6)
    assert choice.queries.uncertainties == pytest.approx(uncertainties, rel=1e-5)
    assert calibration.values['query.level'] == choice.level
    assert calibration.source == '25 scans of drive_0, drive_1'
    assert reported[-1] == (25, 25)
    assert reported == sorted(reported)


def test_drives_of_different_roads_are_refused_before_anything_is_encoded(street_bag: Callable[..., Path]) -> None:
    reported: list[int] = []
    road = open_road([street_bag('here', count=4), street_bag('aside', count=4, lane_m=400.0)])
    with pytest.raises(DataError, match='here: no scan within 25 m of another drive, the nearest 400 m away'):
        calibrate_road(road.drives, RING_KEY, LIMIT, lambda done, _: reported.append(done))
    assert reported == []
