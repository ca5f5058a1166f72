"""Signatures that come by messages: what is missing is asked for, a little at a time, and never for ever."""

from __future__ import annotations

import dataclasses

import pytest
from sample_signatures import packed_signature

from offradar_ros.retrieval.received_signatures import (
    ASK_AGAIN_S,
    MOST_WANTED,
    PUT_BEFORE_CHECK,
    ReceivedSignatures,
)
from offradar_ros.types import ScanKey

SIGNATURE = packed_signature(1)


@dataclasses.dataclass
class Clock:
    """The time that a test sets."""

    now_s: float = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def received(clock: Clock) -> ReceivedSignatures:
    return ReceivedSignatures(clock)


def scans(count: int, session: int = 1, start: int = 0) -> list[ScanKey]:
    return [ScanKey(session, stamp) for stamp in range(start, start + count)]


def test_a_whole_map_comes_in_small_answers_each_after_the_one_before(received: ReceivedSignatures) -> None:
    every = scans(2 * MOST_WANTED + 5)
    received.expect(every)
    asked: list[ScanKey] = []
    while wanted := received.wanted():
        assert len(wanted) <= MOST_WANTED
        assert received.wanted() == ()
        asked += wanted
        assert received.receive({scan: packed_signature(scan.stamp_ns) for scan in wanted}) == []
    assert asked == every
    assert received.missing == 0
    assert received.read(every) == {scan: packed_signature(scan.stamp_ns) for scan in every}


def test_what_a_query_lacks_is_asked_for_next(received: ReceivedSignatures) -> None:
    every = scans(3 * MOST_WANTED)
    received.expect(every)
    first = received.wanted()
    near = [every[170], every[100], every[180]]
    assert received.read(near) == {}
    received.receive(dict.fromkeys(first, SIGNATURE))
    assert received.wanted()[: len(near)] == tuple(near)


def test_a_lost_answer_is_asked_for_again_after_the_others(received: ReceivedSignatures, clock: Clock) -> None:
    every = scans(MOST_WANTED + 1)
    received.expect(every)
    lost = received.wanted()
    clock.now_s += ASK_AGAIN_S - 0.01
    assert received.wanted() == ()
    clock.now_s += 0.02
    again = received.wanted()
    assert again == (every[-1], *lost[:-1])
    received.receive(dict.fromkeys(again, SIGNATURE))
    assert received.wanted() == (lost[-1],)


def test_a_late_answer_to_an_earlier_question_is_taken_up_and_does_not_end_the_wait(
    received: ReceivedSignatures, clock: Clock
) -> None:
    received.expect(scans(2 * MOST_WANTED))
    first = received.wanted()
    clock.now_s += 2 * ASK_AGAIN_S
    second = received.wanted()
    assert not set(first) & set(second)
    received.receive(dict.fromkeys(first, SIGNATURE))
    assert received.wanted() == ()
    received.receive(dict.fromkeys(second, SIGNATURE))
    assert received.missing == 0


def test_a_scan_without_a_signature_is_asked_for_once_a_map(received: ReceivedSignatures, clock: Clock) -> None:
    every = scans(3)
    received.expect(every)
    received.receive({every[0]: SIGNATURE, every[1]: b'', every[2]: SIGNATURE})
    clock.now_s += 10 * ASK_AGAIN_S
    assert received.wanted() == ()
    assert received.read(every) == {every[0]: SIGNATURE, every[2]: SIGNATURE}
    received.expect(every)
    assert received.wanted() == (every[1],)


@pytest.mark.parametrize('content', [b'x', SIGNATURE[:-1], SIGNATURE[:-1] + b'\0', bytes(8192)])
def test_what_is_no_signature_is_told_of_and_not_asked_for_again(
    received: ReceivedSignatures, clock: Clock, content: bytes
) -> None:
    one, other = scans(2)
    received.expect([one, other])
    (problem,) = received.receive({one: content, other: SIGNATURE})
    assert problem.cause == 'invalid_signature'
    clock.now_s += 10 * ASK_AGAIN_S
    assert received.wanted() == ()
    assert received.read([one, other]) == {other: SIGNATURE}


def test_answers_to_others_are_used_but_change_nothing_that_is_here(received: ReceivedSignatures) -> None:
    here, missing, foreign = scans(3)
    received.expect([here, missing])
    received.put(here, SIGNATURE)
    assert received.wanted() == (missing,)
    answer = {here: packed_signature(2), foreign: packed_signature(3), missing: packed_signature(4)}
    assert received.receive(answer) == []
    assert received.read([here, missing, foreign]) == {here: SIGNATURE, missing: packed_signature(4)}
    assert len(received) == 2


def test_those_that_came_with_their_rows_are_not_asked_for(received: ReceivedSignatures) -> None:
    every = scans(3)
    received.put(every[0], SIGNATURE)
    received.put(every[2], SIGNATURE)
    received.expect(every)
    assert received.wanted() == (every[1],)
    # The row may also come after the map.
    received.put(every[1], packed_signature(2))
    assert received.missing == 0
    assert received.read(every)[every[1]] == packed_signature(2)


def test_a_scan_that_comes_again_without_a_signature_has_none(received: ReceivedSignatures) -> None:
    (scan,) = scans(1)
    received.put(scan, SIGNATURE)
    received.put(scan, b'')
    assert received.read([scan]) == {}


def test_another_map_takes_the_place_of_the_former(received: ReceivedSignatures) -> None:
    first, second = scans(3), scans(3, session=2)
    received.expect(first)
    received.receive(dict.fromkeys(first, SIGNATURE))
    received.expect([first[0], *second])
    assert (len(received), received.missing) == (1, 3)
    assert received.wanted() == tuple(second)


def test_memory_is_bounded_by_the_map_however_many_scans_replace_one_another(received: ReceivedSignatures) -> None:
    for number, scan in enumerate(scans(3 * PUT_BEFORE_CHECK)):
        received.put(scan, SIGNATURE)
        if received.is_check_due:
            received.expect([scan])
        assert len(received) <= PUT_BEFORE_CHECK + 1, number
