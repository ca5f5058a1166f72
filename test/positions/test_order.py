"""Odd stamps are left out, and a stream that jumps for good is followed."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.errors import RefusedInput
from offradar_ros.positions.order import MOST_HELD, Admitted, PositionOrder

SECOND = 10**9
NOW = 1_767_225_600
YEARS = 6 * 365 * 86400


def run(stamps_s: list[float], restart_after_s: float = 1.0) -> tuple[list[float], Counter[str]]:
    """The stamps that are used in the end, in the order in which they were accepted, and what was left out by cause."""
    order: PositionOrder[float] = PositionOrder(round(restart_after_s * SECOND))
    used: list[list[float]] = [[]]
    causes: Counter[str] = Counter()
    for stamp_s in stamps_s:
        try:
            admitted = order.add(round(stamp_s * SECOND), stamp_s)
        except RefusedInput as refused:
            causes[refused.cause] += 1
            continue
        collect(admitted, used, causes)
    collect(order.end(), used, causes)
    return [stamp_s for stretch in used for stamp_s in stretch], causes


def collect(admitted: Admitted[float], used: list[list[float]], causes: Counter[str]) -> None:
    causes.update(refused.cause for refused in admitted.left_out)
    if admitted.forgotten:
        used.pop()
    if admitted.jumped:
        used.append([])
    if not used:
        used.append([])
    used[-1] += [stamp_s for _, stamp_s in admitted.positions]


def ticks(start_s: float, count: int, step_s: float = 0.1) -> list[float]:
    return [round(start_s + step_s * k, 3) for k in range(count)]


def test_a_sound_stream_is_used_as_it_is() -> None:
    assert run(ticks(NOW, 50)) == (ticks(NOW, 50), {})
    assert run(ticks(0.0, 50)) == (ticks(0.0, 50), {})
    assert run([*ticks(NOW, 5), *ticks(NOW + 300, 5)]) == ([*ticks(NOW, 5), *ticks(NOW + 300, 5)], {})
    assert run(ticks(NOW, 8, 30.0)) == (ticks(NOW, 8, 30.0), {})


@pytest.mark.parametrize('away_s', [YEARS, -YEARS, 37.0, 18.0, -20.0, -NOW + 5.0])
@pytest.mark.parametrize('odd', [1, 3, 5])
def test_a_few_odd_stamps_in_the_middle_are_left_out(away_s: float, odd: int) -> None:
    before, middle, after = ticks(NOW, 60), ticks(NOW + 6.0 + away_s, odd), ticks(NOW + 6.0 + 0.1 * odd, 60)
    used, causes = run([*before, *middle, *after])
    assert used == [*before, *after]
    assert causes == {'position_stamp_jump': odd}


@pytest.mark.parametrize('away_s', [YEARS, -YEARS, -NOW + 5.0])
@pytest.mark.parametrize('odd', [1, 5, 50])
def test_a_clock_that_is_set_after_a_while_is_believed_then(away_s: float, odd: int) -> None:
    used, causes = run([*ticks(NOW + away_s, odd), *ticks(NOW + 0.1 * odd, 100)])
    assert used == ticks(NOW + 0.1 * odd, 100)
    assert causes == {'position_stamp_jump': odd}


def test_a_small_step_back_is_one_odd_stamp() -> None:
    used, causes = run([*ticks(NOW, 20), NOW + 1.7, NOW + 1.9, *ticks(NOW + 2.0, 20)])
    assert used == ticks(NOW, 40)
    assert causes == {'position_stamp_backwards': 1, 'repeated_position_stamp': 1}


def test_a_recording_that_starts_again_is_followed() -> None:
    used, causes = run([*ticks(NOW, 100), *ticks(NOW, 100)])
    assert used == ticks(NOW, 100) * 2
    assert causes == {}


def test_scans_that_start_again_confirm_at_once() -> None:
    order: PositionOrder[str] = PositionOrder(SECOND)
    order.add(100 * SECOND, 'old')
    assert order.add(50 * SECOND, 'new').positions == ()
    assert order.expect_restart().positions == ((50 * SECOND, 'new'),)
    order.reset()
    order.add(100 * SECOND, 'old')
    assert order.expect_restart().positions == ()
    assert order.add(50 * SECOND, 'new').positions == ((50 * SECOND, 'new'),)


def test_scans_that_started_again_long_ago_confirm_nothing() -> None:
    order: PositionOrder[str] = PositionOrder(SECOND)
    order.add(100 * SECOND, 'old')
    order.expect_restart()
    order.add(103 * SECOND, 'old')
    assert order.add(50 * SECOND, 'odd').positions == ()


def test_scans_that_start_again_confirm_no_jump_forward() -> None:
    order: PositionOrder[str] = PositionOrder(SECOND)
    order.add(100 * SECOND, 'old')
    assert order.add(200 * SECOND, 'odd').positions == ()
    assert order.expect_restart().positions == ()
    order.reset()
    order.add(100 * SECOND, 'old')
    order.expect_restart()
    assert order.add(200 * SECOND, 'odd').positions == ()


def test_a_restart_tells_of_the_odd_stamp_before_it() -> None:
    order: PositionOrder[str] = PositionOrder(SECOND)
    order.add(100 * SECOND, 'old')
    order.add(200 * SECOND, 'odd')
    order.expect_restart()
    admitted = order.add(50 * SECOND, 'new')
    assert admitted.positions == ((50 * SECOND, 'new'),)
    assert [refused.cause for refused in admitted.left_out] == ['position_stamp_jump']


def test_a_second_jump_leaves_the_first_one_unconfirmed() -> None:
    used, causes = run([*ticks(NOW, 20), NOW + 300.0, *ticks(NOW - 3600, 40)])
    assert (used, causes) == ([*ticks(NOW, 20), *ticks(NOW - 3600, 40)], {'position_stamp_jump': 1})


def test_a_small_step_back_after_a_gap_is_one_odd_stamp() -> None:
    used, causes = run([*ticks(NOW, 20), NOW + 60.0, NOW + 59.95, *ticks(NOW + 60.1, 30)])
    assert used == [*ticks(NOW, 20), *ticks(NOW + 60, 31)]
    assert causes == {'position_stamp_backwards': 1}


def test_an_odd_stamp_before_a_gap_starts_no_recording_again() -> None:
    used, causes = run([*ticks(NOW, 60), NOW - 1000.0, *ticks(NOW + 1000, 60)])
    assert used == [*ticks(NOW, 60), *ticks(NOW + 1000, 60)]
    assert causes == {'position_stamp_jump': 1}


def test_a_recording_that_starts_again_just_before_its_end_is_followed() -> None:
    assert run([*ticks(NOW, 100), *ticks(NOW + 8.4, 60)]) == ([*ticks(NOW, 100), *ticks(NOW + 8.4, 60)], {})


def test_two_odd_stamps_confirm_nothing_however_far_apart() -> None:
    used, causes = run([*ticks(NOW, 60), NOW + YEARS, NOW + YEARS + 2.5, *ticks(NOW + 8.5, 60)])
    assert used == [*ticks(NOW, 60), *ticks(NOW + 8.5, 60)]
    assert causes == {'position_stamp_jump': 2}


def test_stamps_that_outnumber_all_before_the_jump_are_believed_at_once() -> None:
    order: PositionOrder[int] = PositionOrder(SECOND)
    order.add(100 * SECOND, 0)
    assert [len(order.add(50 * SECOND + k, k).positions) for k in range(3)] == [0, 0, 3]


def test_a_long_stretch_counts_also_where_the_clock_is_set_after_it() -> None:
    assert run([*ticks(NOW, 200), *ticks(NOW + YEARS, 100)]) == ([*ticks(NOW, 200), *ticks(NOW + YEARS, 100)], {})


def test_what_is_held_is_bounded() -> None:
    order: PositionOrder[int] = PositionOrder(SECOND)
    for k in range(3 * MOST_HELD):
        order.add(10**15 + k * SECOND, k)
    held = next(k for k in range(2 * MOST_HELD) if order.add(k, k).positions)
    assert held < MOST_HELD


def test_a_gap_at_the_end_is_no_odd_stamp() -> None:
    assert run([*ticks(NOW, 20), NOW + 60.0]) == ([*ticks(NOW, 20), NOW + 60.0], {})
    used, causes = run([*ticks(NOW, 20), NOW - 60.0])
    assert (used, causes) == (ticks(NOW, 20), {'position_stamp_jump': 1})
    used, causes = run([*ticks(NOW, 20), NOW + YEARS])
    assert (used, causes) == (ticks(NOW, 20), {'position_stamp_jump': 1})


def test_a_jump_back_at_the_end_is_believed_if_it_is_the_larger_part() -> None:
    assert run([NOW, *ticks(NOW - 3600, 2)]) == ([NOW, *ticks(NOW - 3600, 2)], {})


def places(stamped: list[tuple[float, float]]) -> tuple[list[float], Counter[str]]:
    """As `run`, of stamps in seconds and metres along a road: the metres that are used in the end."""
    order: PositionOrder[float] = PositionOrder(SECOND, lambda a, b: abs(a - b))
    used: list[list[float]] = [[]]
    causes: Counter[str] = Counter()
    for stamp_s, at_m in stamped:
        try:
            collect(order.add(round(stamp_s * SECOND), at_m), used, causes)
        except RefusedInput as refused:
            causes[refused.cause] += 1
    collect(order.end(), used, causes)
    return [at_m for stretch in used for at_m in stretch], causes


def test_a_wrong_place_after_a_gap_is_left_out_as_one_before_it() -> None:
    for gap_s in (0.0, 15.0, -60.0):
        for wrong in ({30}, {31, 32}, {45}, {30, 38, 46}):
            road = [(NOW + 0.1 * k + (gap_s if k >= 30 else 0.0), float(k)) for k in range(90)]
            stamped = [(stamp_s, at_m + 50_000.0 * (at_m in wrong)) for stamp_s, at_m in road]
            used, causes = places(stamped)
            assert used == [at_m for _, at_m in road if at_m not in wrong]
            assert causes == {'position_jump': len(wrong)}


def test_what_is_held_is_kept_where_a_position_is_refused() -> None:
    stamped = [(NOW + 0.5 * k, 0.0) for k in range(4)]
    used, causes = places([*stamped, (NOW + 3.0, 5000.0), (NOW + 1.2, 0.0), (NOW + 3.5, 0.0)])
    assert used == [0.0] * 5
    assert causes == {'position_jump': 1, 'position_stamp_backwards': 1}


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.1, 0.1, 0.5, 15.0]),
            st.sampled_from([0.0, 0.0, 0.0, -0.5, -2.0, -30.0, 1e7]),
            st.sampled_from([0.0, 0.0, 0.0, 5000.0, 2e5]),
        ),
        min_size=40,
        max_size=80,
    )
)
def test_every_position_is_used_or_counted_once_wherever_it_is(steps: list[tuple[float, float, float]]) -> None:
    stamps_s = NOW + np.cumsum([step_s for step_s, _, _ in steps])
    stamped = [(float(stamp_s) + odd_s, odd_m) for stamp_s, (_, odd_s, odd_m) in zip(stamps_s, steps, strict=True)]
    used, causes = places(stamped)
    assert len(used) + causes.total() == len(steps)


@given(st.lists(st.integers(-5, 4_200_000_000), max_size=40))
def test_every_stamp_is_used_or_counted_once(stamps_s: list[int]) -> None:
    used, causes = run([float(stamp_s) for stamp_s in stamps_s])
    assert len(used) + causes.total() == len(stamps_s)
    assert set(used) <= set(stamps_s)
