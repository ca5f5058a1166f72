"""Signatures that come by messages: what is missing is asked for, a little at a time, and never for ever."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Iterable

import pytest
from sample_signatures import packed_signature

from offradar_ros.alignment.signature_code import checksum_of
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


def checksums(scans: Iterable[ScanKey], signature: bytes = SIGNATURE) -> dict[ScanKey, int]:
    """As of a map whose scans all have the same signature."""
    return dict.fromkeys(scans, checksum_of(signature))


def scans(count: int, session: int = 1, start: int = 0) -> list[ScanKey]:
    return [ScanKey(session, stamp) for stamp in range(start, start + count)]


def test_a_whole_map_comes_in_small_answers_each_after_the_one_before(received: ReceivedSignatures) -> None:
    every = scans(2 * MOST_WANTED + 5)
    received.expect({scan: checksum_of(packed_signature(scan.stamp_ns)) for scan in every})
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
    received.expect(checksums(every))
    first = received.wanted()
    near = [every[170], every[100], every[180]]
    assert received.read(near) == {}
    received.receive(dict.fromkeys(first, SIGNATURE))
    assert received.wanted()[: len(near)] == tuple(near)


def test_a_lost_answer_is_asked_for_again_after_the_others(received: ReceivedSignatures, clock: Clock) -> None:
    every = scans(MOST_WANTED + 1)
    received.expect(checksums(every))
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
    received.expect(checksums(scans(2 * MOST_WANTED)))
    first = received.wanted()
    clock.now_s += 2 * ASK_AGAIN_S
    second = received.wanted()
    assert not set(first) & set(second)
    received.receive(dict.fromkeys(first, SIGNATURE))
    assert received.wanted() == ()
    received.receive(dict.fromkeys(second, SIGNATURE))
    assert received.missing == 0


def test_a_scan_without_a_signature_is_never_asked_for(received: ReceivedSignatures) -> None:
    one, other = scans(2)
    received.expect({one: 0, other: checksum_of(SIGNATURE)})
    assert received.missing == 1
    assert received.wanted() == (other,)


def test_one_that_the_server_does_not_have_is_asked_for_once_a_map(received: ReceivedSignatures, clock: Clock) -> None:
    every = scans(3)
    received.expect(checksums(every))
    received.receive({every[0]: SIGNATURE, every[1]: b'', every[2]: SIGNATURE})
    clock.now_s += 10 * ASK_AGAIN_S
    assert received.wanted() == ()
    assert received.read(every) == {every[0]: SIGNATURE, every[2]: SIGNATURE}
    received.expect(checksums(every))
    assert received.wanted() == (every[1],)


@pytest.mark.parametrize('start', [b'OSIG\x09' + bytes(60), b'ODDS' + bytes(2000), b''])
def test_a_whole_signature_that_cannot_be_read_is_told_of_and_not_asked_for_again(
    received: ReceivedSignatures, clock: Clock, start: bytes
) -> None:
    """As a map holds it that another version has made."""
    one, other = scans(2)
    content = (start or b'short') + zlib.crc32(start or b'short').to_bytes(4, 'little')
    received.expect({one: checksum_of(content), other: checksum_of(SIGNATURE)})
    (problem,) = received.receive({one: content, other: SIGNATURE})
    assert problem.cause == 'invalid_signature'
    clock.now_s += 10 * ASK_AGAIN_S
    assert received.wanted() == ()
    assert received.read([one, other]) == {other: SIGNATURE}


def test_a_signature_that_is_not_that_of_the_map_is_told_of_and_asked_for_again_later(
    received: ReceivedSignatures, clock: Clock
) -> None:
    (scan,) = scans(1)
    received.expect(checksums([scan]))
    assert received.wanted() == (scan,)
    damaged = bytearray(SIGNATURE)
    damaged[50] ^= 1
    for content in (packed_signature(2), bytes(damaged), SIGNATURE[:-1] + b'x', SIGNATURE[1:], b'x', SIGNATURE[-4:]):
        (problem,) = received.receive({scan: content})
        assert (problem.cause, '\n' in str(problem)) == ('invalid_signature', False)
        # Not at once: whoever answers so would be asked as fast as it answers.
        assert received.wanted() == ()
    clock.now_s += 2 * ASK_AGAIN_S
    assert received.wanted() == (scan,)
    assert received.receive({scan: SIGNATURE}) == []
    assert received.read([scan]) == {scan: SIGNATURE}


def test_answers_to_others_are_used_but_change_nothing_that_is_here(received: ReceivedSignatures) -> None:
    here, missing, foreign = scans(3)
    received.put(here, SIGNATURE)
    received.expect(checksums([here, missing]))
    assert received.wanted() == (missing,)
    assert received.receive({here: packed_signature(2), foreign: packed_signature(3), missing: SIGNATURE}) == []
    assert received.read([here, missing, foreign]) == {here: SIGNATURE, missing: SIGNATURE}
    assert len(received) == 2


def test_those_that_came_with_their_rows_are_not_asked_for(received: ReceivedSignatures) -> None:
    every = scans(3)
    received.put(every[0], SIGNATURE)
    received.put(every[2], SIGNATURE)
    received.expect(checksums(every))
    assert received.wanted() == (every[1],)
    # The row may also come after the map.
    received.put(every[1], SIGNATURE)
    assert received.missing == 0
    assert received.read(every) == dict.fromkeys(every, SIGNATURE)


def test_a_scan_that_comes_again_without_a_signature_has_none(received: ReceivedSignatures) -> None:
    (scan,) = scans(1)
    received.put(scan, SIGNATURE)
    received.put(scan, b'')
    assert received.read([scan]) == {}


def test_another_map_takes_the_place_of_the_former(received: ReceivedSignatures) -> None:
    first, second = scans(3), scans(3, session=2)
    received.expect(checksums(first))
    received.receive(dict.fromkeys(first, SIGNATURE))
    # The last scan is mapped again, otherwise.
    others = checksums([*second, first[2]], packed_signature(2))
    received.expect({**others, **checksums(first[:1])})
    assert received.wanted() == (*second, first[2])
    assert received.read(first) == {first[0]: SIGNATURE}


def test_memory_is_bounded_by_the_map_however_many_scans_replace_one_another(received: ReceivedSignatures) -> None:
    received.put(ScanKey(9, 9), SIGNATURE)
    for number, scan in enumerate(scans(3 * PUT_BEFORE_CHECK)):
        received.put(scan, SIGNATURE)
        if received.is_check_due:
            received.keep([ScanKey(9, 9), scan])
        assert len(received) <= PUT_BEFORE_CHECK + 2, number
    assert received.read([ScanKey(9, 9)])
