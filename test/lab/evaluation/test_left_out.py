"""Stretches of the mapped road are left out by turns."""

from __future__ import annotations

import numpy as np
import pytest
from street_evaluation import SMALL_PROTOCOL, street_drive

from offradar_ros.calibration.open_set import halves
from offradar_ros.errors import ConfigError
from offradar_ros.lab.evaluation.answers import map_rows
from offradar_ros.lab.evaluation.left_out import maps_of, require_left_out, rows_in_map, stretch_m
from offradar_ros.records import replace

HALVES = replace(SMALL_PROTOCOL, {'leave_out': 'halves'})
STRETCHES = replace(SMALL_PROTOCOL, {'leave_out_m': 50.0})


def test_halves_are_those_that_coefficients_are_fitted_to() -> None:
    mapped = street_drive(0, 61)
    rows, stretch = map_rows(mapped, 8.0), stretch_m(HALVES, mapped.drive)
    found = [rows_in_map(mapped.drive, rows, number, stretch).tolist() for number in maps_of(HALVES)]
    assert found == [half.tolist() for half in halves(mapped.drive.driven_m, rows)]


def test_every_other_stretch_is_left_out() -> None:
    drive = street_drive(0, 60).drive
    first, second = (rows_in_map(drive, np.arange(60), number, 50.0) for number in maps_of(STRETCHES))
    # Scans are 4 m apart.
    assert first.tolist() == [row for row in range(60) if 4 * row // 50 in (0, 2, 4)]
    assert sorted([*first, *second]) == list(range(60))


def test_nothing_is_left_out_by_default() -> None:
    drive = street_drive(0, 60).drive
    (number,) = maps_of(SMALL_PROTOCOL)
    assert rows_in_map(drive, np.arange(60), number, stretch_m(SMALL_PROTOCOL, drive)).tolist() == list(range(60))


def test_a_drive_within_one_stretch_is_refused() -> None:
    drive = street_drive(0, 10).drive
    with pytest.raises(ConfigError, match='expected less than the path length of street_1, 36 m, got 50 m'):
        require_left_out(STRETCHES, drive)
    require_left_out(HALVES, drive)
    require_left_out(SMALL_PROTOCOL, drive)
