from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from offradar_ros.calibration.one_drive import calibrate_drive
from offradar_ros.calibration.parameters import shipped_confidence
from offradar_ros.config import load_config
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError

RING_KEY = load_config(overrides={'encoder.name': 'ring_key'})


def test_the_parameters_give_u_1_on_average_and_progress_is_reported(street: Callable[..., Any]) -> None:
    drive, reported = street(count=6), []
    calibration = calibrate_drive(drive, RING_KEY, 0.0, lambda done, total: reported.append((done, total)))
    encoder = make_encoder(load_config(overrides=calibration.values).encoder)
    assert np.mean([encoder.encode(drive.scan(i)).uncertainty for i in range(6)]) == pytest.approx(1.0, abs=1e-6)
    assert calibration.source == '6 scans of street'
    assert reported == [(done, 6) for done in range(1, 7)]
    assert calibrate_drive(drive, RING_KEY, 0.0) == calibration


def test_a_drive_of_silent_scans_is_refused_with_the_cause(street: Callable[..., Any]) -> None:
    with pytest.raises(DataError, match=r'street: .* got 0; 3 of 3 scans refused: no_signal: '):
        calibrate_drive(street(count=3, silent=True), RING_KEY, 0.01)


def test_shipped_coefficients_are_kept_with_the_usual_u_of_the_drive(street: Callable[..., Any]) -> None:
    drive = street(count=8)
    calibration = calibrate_drive(drive, RING_KEY, 0.0)
    config = load_config(overrides=calibration.values)
    encoder = make_encoder(config.encoder)
    usual = float(np.median([encoder.encode(drive.scan(i)).uncertainty for i in range(8)]))
    shipped = shipped_confidence(RING_KEY, config.query.confidence.usual_uncertainty)
    assert shipped is not None
    assert config.query.confidence == dataclasses.replace(shipped, model=config.query.model)
    assert config.query.confidence.usual_uncertainty == pytest.approx(usual)
    assert 'query.min_probability' not in calibration.values
