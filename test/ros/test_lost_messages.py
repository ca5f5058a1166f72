"""Gaps in the publishers' numbers are counted, whoever sends in between."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.ros.lost_messages import DOUBTED, LostMessages


def numbered(number: int | None) -> dict[str, int | None]:
    return {'publication_sequence_number': number}


def lost(numbers: list[int], publishers: int = 1) -> int:
    watch = LostMessages(lambda: publishers)
    return sum(watch.arrived(numbered(number)) for number in numbers)


@given(first=st.integers(1, 1000), arrived=st.lists(st.booleans(), min_size=1, max_size=60))
@settings(max_examples=100, deadline=None)
def test_every_message_between_the_first_and_the_last_is_received_or_lost(first: int, arrived: list[bool]) -> None:
    numbers = [first + k for k, here in enumerate([True, *arrived]) if here]
    assert len(numbers) + lost(numbers) == numbers[-1] - numbers[0] + 1


@given(
    kept=st.lists(st.lists(st.booleans(), min_size=1, max_size=40), min_size=2, max_size=3),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=100, deadline=None)
def test_the_sum_over_several_publishers_that_start_together_is_right(kept: list[list[bool]], seed: int) -> None:
    """Each starts at 1 and is heard at once; then any are lost, and they mix in any order, up to the same number."""
    streams = [[1, *(2 + k for k, here in enumerate(stream) if here), 42] for stream in kept]
    order = np.random.default_rng(seed).permutation([i for i, s in enumerate(streams) for _ in s[1:-1]])
    rest = [iter(stream[1:]) for stream in streams]
    numbers = [1] * len(streams) + [next(rest[i]) for i in order] + [42] * len(streams)
    expected = sum(42 - len(stream) for stream in streams)
    assert lost(numbers, len(streams)) == expected


def test_a_publisher_that_starts_again_loses_nothing() -> None:
    assert lost([1, 2, 3, 1, 2, 3, 4, 5]) == 0
    assert lost([500, 501, 1, 2, 3, *range(4, 600)]) == 0
    assert lost([500, 501, 1, 4, 500, 503]) == 2 + 495 + 2


def test_a_publisher_that_has_sent_for_long_loses_nothing_when_it_is_first_heard() -> None:
    assert lost([50, 1000, 51, 1001, 53], publishers=2) == 1


@given(arrived=st.lists(st.booleans(), min_size=1, max_size=60), publishers=st.integers(2, 4))
@settings(max_examples=100, deadline=None)
def test_publishers_that_say_nothing_hide_no_loss(arrived: list[bool], publishers: int) -> None:
    numbers = [1 + k for k, here in enumerate([True, *arrived, *[True] * DOUBTED]) if here]
    assert len(numbers) + lost(numbers, publishers) == numbers[-1]


def test_a_gap_counts_once_it_is_no_longer_doubted() -> None:
    watch = LostMessages(lambda: 2)
    found = [watch.arrived(numbered(number)) for number in (1, *range(5, 6 + DOUBTED))]
    assert found == [0] * DOUBTED + [3, 0]


def test_a_number_of_a_publisher_that_has_ended_hides_no_loss() -> None:
    publishers = 2
    watch = LostMessages(lambda: publishers)
    numbers = [*range(1, 101), 1, 2]
    assert sum(watch.arrived(numbered(number)) for number in numbers) == 0
    publishers = 1
    assert [watch.arrived(numbered(number)) for number in (3, 4, 111)] == [0, 0, 106]


def test_without_numbers_the_stamps_give_an_estimate() -> None:
    watch = LostMessages(lambda: 1)
    steps = [0.25] * 10 + [0.75] + [0.25] * 3 + [1.0, 60.0, 0.25, -50.0, 0.25]
    stamps = [round(t * 1e9) for t in itertools.accumulate(steps)]
    assert [watch.arrived(numbered(None), stamp) for stamp in stamps] == [0] * 10 + [2, 0, 0, 0, 3, 0, 0, 0, 0]


@pytest.mark.parametrize('stamp', [None, 0])
def test_without_both_nothing_is_said(stamp: int | None) -> None:
    watch = LostMessages(lambda: 1)
    assert [watch.arrived({}, stamp) for _ in range(9)] == [0] * 9
