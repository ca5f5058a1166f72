"""Stretches of a recording, as a trajectory."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import Trajectory
from offradar_ros.positions.track import PositionTrack

SECOND = 10**9
NOW = 1_767_225_600


def track_of(stamps_s: list[tuple[float, float]]) -> Trajectory:
    """From stamps in seconds and latitudes."""
    return filled(stamps_s).trajectory()


def filled(stamps_s: list[tuple[float, float]]) -> PositionTrack:
    track = PositionTrack(geodetic=True)
    for stamp_s, latitude in stamps_s:
        try:
            track.add_point(round(stamp_s * SECOND), (latitude, -1.25, 60.0))
        except RefusedInput as refused:
            track.leave_out(refused.cause, str(refused))
    return track


def stretch(start_s: float, seconds: float, latitude: float) -> list[tuple[float, float]]:
    return [(NOW + start_s + k / 10, latitude) for k in range(round(seconds * 10))]


@pytest.mark.parametrize(('first_s', 'second_s', 'kept'), [(20.0, 60.0, 51.8), (60.0, 20.0, 51.7), (20.0, 20.0, 51.8)])
def test_where_stretches_overlap_the_longer_counts_and_of_equal_ones_the_later(
    first_s: float, second_s: float, kept: float
) -> None:
    """A clock that is set back by 5 s in the middle."""
    found = track_of([*stretch(0.0, first_s, 51.7), *stretch(first_s - 5.0, second_s, 51.8)])
    assert np.all(np.diff(found.stamps_ns) > 0)
    overlap = (found.stamps_ns >= (NOW + first_s - 5.0) * SECOND) & (found.stamps_ns < (NOW + first_s) * SECOND)
    assert found.positions[overlap, 0].tolist() == [kept] * 50
    (left_out,) = found.left_out
    assert (left_out.cause, left_out.count) == ('position_stamp_backwards', 50)
    assert len(found) == round((first_s + second_s) * 10) - 50


def test_a_long_stretch_of_a_clock_not_yet_set_is_left_out() -> None:
    found = track_of([*stretch(-200 * 86400.0, 40.0, 51.7), *stretch(0.0, 60.0, 51.7)])
    assert len(found) == 600
    (left_out,) = found.left_out
    assert (left_out.cause, left_out.count) == ('position_stamp_jump', 400)


def test_a_gap_of_a_weekend_is_kept() -> None:
    found = track_of([*stretch(-2 * 86400.0, 40.0, 51.7), *stretch(0.0, 60.0, 51.7)])
    assert (len(found), found.left_out) == (1000, ())


def test_a_stretch_on_both_sides_of_a_longer_one_is_used_on_both() -> None:
    found = track_of([*stretch(10.0, 30.0, 51.7), *stretch(0.0, 5.0, 51.8), *stretch(45.0, 15.0, 51.8)])
    assert (len(found), found.left_out) == (500, ())
    around = [(NOW + 2.5 * k, 51.8) for k in range(25)]
    found = track_of([*stretch(10.0, 30.0, 51.7), *around])
    assert found.positions[:, 0].tolist() == [51.8] * 4 + [51.7] * 300 + [51.8] * 9
    assert {left_out.cause: left_out.count for left_out in found.left_out} == {'position_stamp_backwards': 12}


@pytest.mark.parametrize(
    'stamped',
    [
        [(NOW + 15.0 * k, 51.7) for k in range(20_000)],
        [(NOW + k, 51.7 + 2.0 * (k == 500)) for k in range(100_000)],
    ],
    ids=['a position each 15 s', 'one wrong place'],
)
def test_a_trajectory_is_made_in_a_time_that_grows_with_its_length(stamped: list[tuple[float, float]]) -> None:
    track = filled(stamped)
    started = time.process_time()
    assert len(track.trajectory()) >= len(stamped) - 1
    assert time.process_time() - started < 2.0


@given(st.lists(st.tuples(st.integers(0, 200), st.sampled_from([51.7, -33.9, 0.0])), max_size=60))
def test_any_stream_is_a_trajectory_that_counts_the_rest(stamps: list[tuple[int, float]]) -> None:
    found = track_of([(stamp / 4, latitude) for stamp, latitude in stamps])
    assert np.all(np.diff(found.stamps_ns) > 0)
    assert len(found) + sum(left_out.count for left_out in found.left_out) == len(stamps)
