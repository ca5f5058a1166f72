"""The distance driven between two stamps, as far as odometry knows it at the later one."""

from __future__ import annotations

import pytest

from offradar_ros.belief.odometry import Odometry
from offradar_ros.errors import RefusedInput
from offradar_ros.types import Pose

S = 10**9


def odometry(*positions: tuple[float, float]) -> Odometry:
    """Positions (seconds, x)."""
    made = Odometry(S)
    for second, x_m in positions:
        made.add(round(second * S), Pose(x_m, 0.0))
    return made


def test_the_last_position_up_to_a_stamp_counts_and_later_ones_do_not() -> None:
    known = odometry((1.0, 0.0), (1.2, 2.0), (1.4, 4.0), (1.6, 6.0))
    assert known.driven_m(round(1.25 * S), round(1.5 * S), 25.0) == pytest.approx(2.0)
    # Stretches add up, because each starts where the one before ended.
    assert known.driven_m(round(1.5 * S), round(1.75 * S), 25.0) == pytest.approx(2.0)


def test_a_distance_is_unknown_without_a_recent_position_at_either_end() -> None:
    assert odometry().driven_m(S, 2 * S, 25.0) is None
    assert odometry((1.0, 0.0)).driven_m(2 * S, 3 * S, 25.0) is None
    assert odometry((2.0, 0.0)).driven_m(S, 2 * S, 25.0) is None
    assert odometry((1.0, 0.0), (2.0, 5.0)).driven_m(S, 2 * S, 25.0) == pytest.approx(5.0)


def test_a_jump_that_the_vehicle_cannot_make_is_not_a_distance() -> None:
    assert odometry((1.0, 0.0), (1.25, 500.0)).driven_m(S, round(1.25 * S), 25.0) is None


def test_stamps_go_forward_unless_a_recording_starts_again() -> None:
    known = odometry((10.0, 0.0))
    with pytest.raises(RefusedInput, match='odometry of stamp'):
        known.add(round(9.5 * S), Pose(1.0, 0.0))
    known.add(S, Pose(0.0, 0.0))
    known.add(round(1.25 * S), Pose(3.0, 0.0))
    assert known.driven_m(S, round(1.25 * S), 25.0) == pytest.approx(3.0)
