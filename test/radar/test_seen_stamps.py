"""A scan counts once, until a recording starts again."""

from __future__ import annotations

import pytest

from offradar_ros.errors import RefusedInput
from offradar_ros.radar.seen_stamps import KEPT, SeenStamps

SECOND = 10**9
STAMPS = [round(index * 0.25 * SECOND) for index in range(1, 41)]


def accepted(seen: SeenStamps, stamps: list[int], model: str = 'a') -> list[int]:
    found = []
    for stamp in stamps:
        try:
            seen.check(stamp, model)
        except RefusedInput as problem:
            assert problem.cause == 'repeated_scan'
        else:
            found.append(stamp)
    return found


@pytest.mark.parametrize('lag', [0, 1, 3])
def test_of_two_that_send_the_same_one_counts(lag: int) -> None:
    twice = STAMPS[:lag] + [stamp for pair in zip(STAMPS[lag:], STAMPS, strict=False) for stamp in pair] + STAMPS[-lag:]
    assert accepted(SeenStamps(SECOND), twice if lag else sorted([*STAMPS, *STAMPS])) == STAMPS


def test_a_recording_that_starts_again_counts_again() -> None:
    assert accepted(SeenStamps(SECOND), STAMPS * 3) == STAMPS * 3


def test_of_two_that_send_a_recording_that_starts_again_one_counts() -> None:
    twice = [stamp for stamp in STAMPS for _ in range(2)]
    assert accepted(SeenStamps(SECOND), twice * 2) == STAMPS * 2


def test_a_recording_starts_again_by_its_newest_stamp() -> None:
    seen = SeenStamps(SECOND)
    assert accepted(seen, [10 * SECOND, 10 * SECOND - SECOND // 2, 9 * SECOND - 1]) != []
    assert accepted(seen, [10 * SECOND]) == [10 * SECOND]


def test_a_short_recording_counts_again_where_its_start_is_announced() -> None:
    seen = SeenStamps(SECOND)
    short = STAMPS[:3]
    assert accepted(seen, short * 2) == short
    seen.reset()
    assert accepted(seen, short) == short


def test_models_are_apart() -> None:
    seen = SeenStamps(SECOND)
    assert accepted(seen, STAMPS[:3], 'a') == accepted(seen, STAMPS[:3], 'b') == STAMPS[:3]
    assert accepted(seen, STAMPS[:3], 'b') == []


def test_scans_out_of_order_count() -> None:
    shuffled = [stamp for pair in zip(STAMPS[1::2], STAMPS[::2], strict=True) for stamp in pair]
    assert accepted(SeenStamps(SECOND), shuffled) == shuffled


def test_memory_is_bounded() -> None:
    seen = SeenStamps(10**18)
    stamps = list(range(KEPT + 1))
    assert accepted(seen, stamps) == stamps
    assert accepted(seen, [0, KEPT]) == [0]
