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
from offradar_ros.geometry import LocalFrame, Trajectory

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


def test_shipped_coefficients_are_kept_and_only_what_the_sensor_shifts_is_shifted(street: Callable[..., Any]) -> None:
    drive, shipped = street(count=8), shipped_confidence(RING_KEY)
    assert shipped is not None
    calibration = calibrate_drive(drive, RING_KEY, 0.0)
    query = load_config(overrides=calibration.values).query
    encoder = make_encoder(load_config(overrides=calibration.values).encoder)
    usual = float(np.median([encoder.encode(drive.scan(i)).uncertainty for i in range(8)]))
    # Ten metres of road say nothing of distances.
    kept = dataclasses.replace(shipped, model=query.model, usual_uncertainty=query.confidence.usual_uncertainty)
    assert query.confidence == kept
    assert query.confidence.usual_uncertainty == pytest.approx(usual)
    assert 'query.min_probability' not in calibration.values
    assert any('distances as shipped: their scale takes 1 km' in line for line in calibration.lines)


def test_a_kilometre_with_positions_shifts_the_scale_of_distances_and_without_them_nothing(
    street: Callable[..., Any],
) -> None:
    made, shipped = street(count=201), shipped_confidence(RING_KEY)
    assert shipped is not None
    track = made.trajectory.in_frame(LocalFrame(made.trajectory.origin()))
    # Said to be 5 m from scan to scan.
    stretched = dataclasses.replace(track, positions=track.positions * 4.0)
    found = {
        name: load_config(
            overrides=calibrate_drive(made.with_trajectory(positions), RING_KEY, 0.0).values
        ).query.confidence
        for name, positions in (('kilometre', stretched), ('none', None), ('elsewhen', _late(stretched)))
    }
    assert found['kilometre'].distance != shipped.distance
    assert found['none'].distance == found['elsewhen'].distance == shipped.distance
    assert found['kilometre'] == dataclasses.replace(found['none'], distance=found['kilometre'].distance)


def _late(track: Trajectory) -> Trajectory:
    """The same positions, none of them at the time of a scan."""
    return dataclasses.replace(track, stamps_ns=track.stamps_ns + 10**13)
