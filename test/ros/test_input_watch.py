"""An input is silent when a message is overdue by its usual period."""

from __future__ import annotations

import pytest

from offradar_ros.ros.input_watch import ERROR_AFTER, FIRST_S, LEAST_S, PERIODS, InputWatch


class Clock:
    """Seconds, as the test sets them."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_the_first_message_may_take_a_while(clock: Clock) -> None:
    watch = InputWatch(clock)
    clock.now_s += FIRST_S
    assert not watch.is_silent
    clock.now_s += 0.1
    assert (watch.ever, watch.is_silent, watch.is_dead) == (False, True, False)
    clock.now_s += ERROR_AFTER * FIRST_S
    assert watch.is_dead


@pytest.mark.parametrize(('period_s', 'patience_s'), [(0.05, LEAST_S), (0.25, LEAST_S), (2.0, PERIODS * 2.0)])
def test_a_silence_is_measured_in_usual_periods(clock: Clock, period_s: float, patience_s: float) -> None:
    watch = InputWatch(clock)
    for _ in range(20):
        clock.now_s += period_s
        watch.received()
    clock.now_s += patience_s - 0.01
    assert not watch.is_silent
    clock.now_s += 0.02
    assert (watch.is_silent, watch.is_dead) == (True, False)
    clock.now_s += ERROR_AFTER * patience_s
    assert watch.is_dead
    watch.received()
    assert not watch.is_silent


def test_one_long_pause_does_not_make_it_patient(clock: Clock) -> None:
    watch = InputWatch(clock)
    for pause_s in (0.25, 0.25, 600.0, 0.25, 0.25):
        clock.now_s += pause_s
        watch.received()
    clock.now_s += LEAST_S + 0.1
    assert watch.is_silent


def test_a_node_that_becomes_active_starts_to_wait(clock: Clock) -> None:
    watch = InputWatch(clock)
    watch.received()
    clock.now_s += 1e6
    watch.restart()
    assert (watch.ever, watch.is_silent) == (False, False)
