"""A position that no vehicle can have driven to does not count, and one odd position does not lose the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from offradar_ros.positions.jumps import PositionJumps
from offradar_ros.types import Pose

SECOND = 10**9
PERIOD_NS = SECOND // 10
SPEED_MPS = 8.0


def drive(seconds: float, offset_m: Callable[[float], float] = lambda _: 0.0) -> list[tuple[int, Pose]]:
    """Northwards at 8 m/s, ten positions a second, moved eastwards by `offset_m` of the time in seconds."""
    stamps = range(0, round(seconds * SECOND), PERIOD_NS)
    return [(stamp, Pose(offset_m(stamp / SECOND), SPEED_MPS * stamp / SECOND)) for stamp in stamps]


def check(jumps: PositionJumps, positions: Iterable[tuple[int, Pose]]) -> tuple[list[tuple[int, Pose]], int, int]:
    """The positions that count, the number of those left out, and of jumps that were believed."""
    accepted: list[tuple[int, Pose]] = []
    left_out = jumped = 0
    for stamp, pose in positions:
        checked = jumps.add(stamp, pose)
        accepted += checked.poses
        left_out += len(checked.left_out)
        jumped += checked.jumped
        assert {refusal.cause for refusal in checked.left_out} <= {'position_jump'}
    return accepted, left_out, jumped


def within(start_s: float, end_s: float, offset_m: float) -> Callable[[float], float]:
    return lambda at_s: offset_m if start_s - 1e-6 < at_s < end_s - 1e-6 else 0.0


def test_a_drive_counts_whole() -> None:
    positions = drive(10.0)
    assert check(PositionJumps(), positions) == (positions, 0, 0)


def test_a_single_jump_is_left_out() -> None:
    positions = drive(10.0, within(4.0, 4.1, 500.0))
    assert check(PositionJumps(), positions) == (drive(4.0) + drive(10.0)[41:], 1, 0)


def test_some_seconds_elsewhere_are_left_out() -> None:
    accepted, left_out, jumped = check(PositionJumps(), drive(12.0, within(4.0, 8.0, 500.0)))
    assert (accepted, left_out, jumped) == (drive(4.0) + drive(12.0)[80:], 40, 0)


def test_positions_all_over_the_place_are_left_out() -> None:
    positions = drive(10.0, lambda at_s: 500.0 * (round(at_s * 10) % 7 - 3) if 4.0 < at_s < 6.0 else 0.0)
    accepted, _, jumped = check(PositionJumps(), positions)
    assert all(pose.x_m == 0.0 for _, pose in accepted)
    assert jumped == 0


def test_a_jump_that_lasts_is_believed_with_all_of_its_positions() -> None:
    positions = drive(12.0, within(4.0, 99.0, 500.0))
    assert check(PositionJumps(), positions) == (positions, 0, 1)


def test_a_wrong_first_position_does_not_stand_against_the_others() -> None:
    positions = drive(8.0, within(0.0, 0.1, 500.0))
    assert check(PositionJumps(), positions) == (positions, 0, 1)


def test_at_the_end_the_larger_part_counts() -> None:
    short, long = PositionJumps(), PositionJumps()
    check(short, drive(3.0, within(1.0, 99.0, 500.0)))
    ended = short.end()
    assert (len(ended.poses), len(ended.left_out), ended.jumped) == (20, 0, True)
    check(long, drive(3.0, within(2.0, 99.0, 500.0)))
    ended = long.end()
    assert (len(ended.poses), len(ended.left_out), ended.jumped) == (0, 10, False)


def test_a_tunnel_is_no_jump() -> None:
    positions = [each for each in drive(300.0) if not 60 * SECOND < each[0] < 240 * SECOND]
    assert check(PositionJumps(), positions) == (positions, 0, 0)


def test_a_receiver_whose_error_changes_is_believed() -> None:
    positions = drive(10.0, lambda at_s: 40.0 * (round(at_s * 10) % 2))
    assert check(PositionJumps(), positions) == (positions, 0, 0)


def test_stamps_that_go_back_start_again() -> None:
    jumps = PositionJumps()
    first = drive(10.0)
    again = [(stamp, Pose(pose.x_m + 5000.0, pose.y_m)) for stamp, pose in first]
    check(jumps, first)
    assert check(jumps, again) == (again, 0, 0)


def test_what_is_held_is_bounded() -> None:
    jumps = PositionJumps()
    jumps.add(0, Pose(0.0, 0.0))
    # All within the time that confirms a jump.
    accepted, _, jumped = check(jumps, ((stamp, Pose(500.0, 0.0)) for stamp in range(1, 5000)))
    assert jumped == 1
    assert len(accepted) == 4999
