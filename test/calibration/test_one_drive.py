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
from offradar_ros.types import PolarScan

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


def test_scans_that_are_repeated_are_left_out(street: Callable[..., Any]) -> None:
    drive = street(count=12)

    class Repeating:
        name, stamps_ns, layout, trajectory = drive.name, drive.stamps_ns, drive.layout, drive.trajectory

        def __init__(self, every: int) -> None:
            self._every = every

        def __len__(self) -> int:
            return len(drive)

        def scan(self, index: int) -> PolarScan:
            scan: PolarScan = drive.scan(index - index % self._every)
            return dataclasses.replace(scan, stamp_ns=int(drive.stamps_ns[index]))

    found = calibrate_drive(Repeating(3), RING_KEY, 0.05)
    assert found.lines[0].startswith('4 of 12 scans: ')
    with pytest.raises(DataError, match='got 1; 11 of 12 scans refused: repeated_power: '):
        calibrate_drive(Repeating(12), RING_KEY, 0.05)
