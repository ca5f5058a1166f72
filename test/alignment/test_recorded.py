"""Recorded scans: consecutive ones against odometry, and two sessions of one place."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from recorded_alignment import (
    Drive,
    Errors,
    Prepared,
    bay_errors,
    damaged_errors,
    foreign_scores,
    loops,
    oxford,
    oxford_errors,
    prepared,
    steps_apart,
    there_and_back,
    way_back,
    whole_drive,
)

from offradar_ros.alignment.align import align
from offradar_ros.recordings.source import open_source

MOST_FOREIGN_SCORE = 0.3
"""Scans of two places reach less."""


@pytest.fixture(scope='module')
def drive(real_data: Path) -> Drive:
    return oxford(real_data)


@pytest.fixture(scope='module')
def scans(drive: Drive) -> list[Prepared]:
    return prepared(drive.scans)


@pytest.fixture(scope='module')
def fog(real_data: Path) -> list[Prepared]:
    sequence = open_source(real_data / 'radiate_tiny_foggy')
    return prepared([sequence.scan(row) for row in range(len(sequence))])


def assert_within(errors: Errors, metres: float, degrees: float) -> None:
    assert np.median(errors.metres) <= metres
    assert np.median(errors.degrees) <= degrees


@pytest.mark.parametrize(('steps', 'metres', 'degrees'), [(1, 0.15, 0.3), (2, 0.25, 0.3), (3, 0.3, 0.4)])
def test_consecutive_scans_of_oxford_agree_with_its_odometry(
    drive: Drive, scans: list[Prepared], steps: int, metres: float, degrees: float
) -> None:
    errors = oxford_errors(drive, scans, steps)
    assert_within(errors, metres, degrees)
    assert errors.metres.max() < 0.5
    assert errors.degrees.max() < 1.0
    assert errors.scores.min() > MOST_FOREIGN_SCORE


def test_the_motion_of_the_vehicle_may_be_taken_out(drive: Drive) -> None:
    """Both scans bend alike: it changes little."""
    assert_within(oxford_errors(drive, prepared(drive.scans, drive.twists()), 1), 0.15, 0.3)


def test_ten_steps_lead_where_the_odometry_does(drive: Drive, scans: list[Prepared]) -> None:
    metres, degrees = whole_drive(drive, scans)
    assert metres < 0.75
    assert degrees < 1.5


def test_the_odometry_has_y_to_the_right_and_yaw_clockwise(drive: Drive, scans: list[Prepared]) -> None:
    mirrored = Drive(drive.scans, [step * [1.0, -1.0, -1.0] for step in drive.steps])
    assert oxford_errors(mirrored, scans, 3).degrees.mean() > 3.0 * oxford_errors(drive, scans, 3).degrees.mean()


def test_damaged_scans_are_aligned_as_well(drive: Drive) -> None:
    for fault, errors in damaged_errors(drive).items():
        assert np.median(errors.metres) <= 0.2, fault
        assert np.median(errors.degrees) <= 0.4, fault
        right = (errors.metres < 0.5) & (errors.degrees < 1.0)
        assert errors.scores[~right].max(initial=0.0) < MOST_FOREIGN_SCORE, fault


def test_a_vehicle_at_rest_does_not_move(real_data: Path) -> None:
    sequence = open_source(real_data / 'mulran_kaist03')
    ready = prepared([sequence.scan(row) for row in range(len(sequence))])
    found = [align(a.place, b.query) for a, b in itertools.permutations(ready, 2)]
    errors = Errors.of(found, [np.zeros(3)] * len(found))
    assert errors.metres.max() < 0.05
    assert errors.degrees.max() < 0.1
    assert errors.scores.min() > 0.8


@pytest.mark.parametrize('steps', [1, 3, 8])
def test_in_fog_the_way_back_is_the_inverse(fog: list[Prepared], steps: int) -> None:
    errors = there_and_back(fog, steps)
    assert errors.metres.max() < 0.15
    assert errors.degrees.max() < 0.15
    # It is not at rest.
    assert all(np.hypot(*one.pose[:2]) > 2.0 * steps for one in steps_apart(fog, steps))


@pytest.mark.parametrize(('steps', 'metres', 'degrees'), [(2, 0.15, 0.3), (3, 0.3, 0.5), (8, 0.5, 0.5)])
def test_in_fog_single_steps_lead_where_one_long_one_does(
    fog: list[Prepared], steps: int, metres: float, degrees: float
) -> None:
    errors = loops(fog, steps)
    assert errors.metres.max() < metres
    assert errors.degrees.max() < degrees


def test_another_session_of_the_bay_has_the_heading_of_its_correlation(real_data: Path) -> None:
    """Which is known to 1.4°. Heading is any: the boat drifts."""
    errors = bay_errors(real_data)[2]
    assert np.median(errors.degrees) < 1.5
    assert np.quantile(errors.degrees, 0.9) < 4.0
    assert np.quantile(errors.metres, 0.9) < 3.0
    assert errors.scores[errors.degrees > 10.0].max(initial=0.0) < MOST_FOREIGN_SCORE


def test_the_way_back_through_a_car_park_has_the_opposite_heading(real_data: Path) -> None:
    """Its notes say 186° ± 6° beside the building; the first scan is still turning."""
    found = way_back(real_data)
    np.testing.assert_allclose(found.headings_deg, found.expected_deg, rtol=0.0, atol=6.0)
    np.testing.assert_allclose(found.headings_deg[1:], 186.0, rtol=0.0, atol=6.0)


def test_scans_of_other_recordings_agree_less(real_data: Path, drive: Drive, scans: list[Prepared]) -> None:
    foreign = foreign_scores(real_data)
    assert foreign.max() < MOST_FOREIGN_SCORE
    for steps in (1, 2, 3):
        assert oxford_errors(drive, scans, steps).scores.min() > foreign.max() + 0.2
