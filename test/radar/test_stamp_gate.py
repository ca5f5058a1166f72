from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.errors import RefusedInput
from offradar_ros.radar.stamps import StampGate

SECOND = 10**9


def test_increasing_stamps_are_accepted() -> None:
    gate = StampGate(5 * SECOND)
    assert [gate.check(s) for s in (0, 1, 10 * SECOND, 10**18)] == [False] * 4


def test_a_repeated_stamp_is_refused_and_the_next_is_accepted() -> None:
    gate = StampGate(5 * SECOND)
    gate.check(100)
    with pytest.raises(RefusedInput) as refused:
        gate.check(100)
    assert refused.value.cause == 'repeated_stamp'
    assert gate.check(101) is False


def test_a_small_jump_back_is_refused_and_changes_nothing() -> None:
    gate = StampGate(5 * SECOND)
    gate.check(100 * SECOND)
    for stamp in (99 * SECOND, 95 * SECOND):
        with pytest.raises(RefusedInput) as refused:
            gate.check(stamp)
        assert refused.value.cause == 'stamp_backwards'
    with pytest.raises(RefusedInput):
        gate.check(100 * SECOND)


def test_a_large_jump_back_is_a_restart() -> None:
    gate = StampGate(5 * SECOND)
    gate.check(100 * SECOND)
    assert gate.check(95 * SECOND - 1) is True
    assert gate.check(95 * SECOND) is False


@pytest.mark.parametrize('stamp', [100 * SECOND, 99 * SECOND, 101 * SECOND])
def test_after_a_reset_any_stamp_is_accepted(stamp: int) -> None:
    gate = StampGate(5 * SECOND)
    gate.check(100 * SECOND)
    gate.reset()
    assert gate.check(stamp) is False
    with pytest.raises(RefusedInput):
        gate.check(stamp)


@given(st.lists(st.integers(0, 20 * SECOND), max_size=30))
def test_accepted_stamps_increase_between_restarts(stamps: list[int]) -> None:
    gate = StampGate(5 * SECOND)
    accepted: list[int] = []
    came: set[int] = set()
    for stamp in stamps:
        try:
            restarted = gate.check(stamp)
        except RefusedInput as refusal:
            assert 0 <= accepted[-1] - stamp <= 5 * SECOND
            assert refusal.cause == ('repeated_stamp' if stamp in came else 'stamp_backwards')
            came.add(stamp)
            continue
        came = {stamp} if restarted else came | {stamp}
        if accepted:
            assert restarted == (stamp < accepted[-1])
            assert restarted == (accepted[-1] - stamp > 5 * SECOND)
        accepted.append(stamp)


@pytest.mark.parametrize('stamp_ns', [-1, -(10**18), 2**31 * 10**9])
def test_a_stamp_that_is_no_time_changes_nothing(stamp_ns: int) -> None:
    gate = StampGate(10**9)
    gate.check(5 * 10**9)
    with pytest.raises(RefusedInput) as refused:
        gate.check(stamp_ns)
    assert refused.value.cause == 'invalid_stamp'
    assert not gate.check(6 * 10**9)
