"""Embeddings wait for their positions."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.config import PositionConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.pending import PendingEmbeddings, Resolved
from offradar_ros.types import Embedding, Pose

SECOND = 10**9
CONFIG = PositionConfig(max_gap_s=1.5, wait_s=10.0, heading='none')

Outcome = tuple[float, float | None, str]
"""Stamp in seconds, x in metres where the position is known, and the cause where it is not."""


def at(seconds: float) -> Embedding:
    return Embedding(round(seconds * SECOND), np.zeros(2, np.float32), np.ones(2, np.float32))


def position(pending: PendingEmbeddings, seconds: float) -> list[Outcome]:
    return outcome(pending.add_position(round(seconds * SECOND), Pose(10.0 * seconds, 0.0)))


def outcome(resolved: list[Resolved]) -> list[Outcome]:
    return [(one.embedding.stamp_ns / SECOND, one.pose.x_m if one.pose else None, one.cause) for one in resolved]


def test_an_embedding_waits_for_the_position_after_it() -> None:
    pending = PendingEmbeddings(CONFIG)
    assert position(pending, 1.0) == []
    assert outcome(pending.add_embedding(at(1.5))) == []
    assert len(pending) == 1
    assert position(pending, 2.0) == [(1.5, 15.0, '')]


def test_an_embedding_with_a_known_position_is_resolved_at_once() -> None:
    pending = PendingEmbeddings(CONFIG)
    position(pending, 1.0), position(pending, 2.0)
    assert outcome(pending.add_embedding(at(1.25))) == [(1.25, 12.5, '')]


def test_before_the_first_position_and_in_a_gap_an_embedding_is_dropped() -> None:
    pending = PendingEmbeddings(CONFIG)
    pending.add_embedding(at(0.5))
    assert position(pending, 1.0) == [(0.5, None, 'no_position')]
    pending.add_embedding(at(2.0))
    assert position(pending, 3.0) == [(2.0, None, 'no_position')]


def test_embeddings_are_resolved_in_order_of_arrival() -> None:
    pending = PendingEmbeddings(CONFIG)
    position(pending, 1.0)
    position(pending, 1.4)
    pending.add_embedding(at(2.0))
    assert outcome(pending.add_embedding(at(1.2))) == []
    assert position(pending, 2.5) == [(2.0, 20.0, ''), (1.2, 12.0, '')]


def test_an_embedding_that_waits_too_long_is_dropped() -> None:
    pending = PendingEmbeddings(CONFIG)
    position(pending, 1.0)
    pending.add_embedding(at(2.0))
    assert outcome(pending.add_embedding(at(12.0))) == []
    assert outcome(pending.add_embedding(at(12.1))) == [(2.0, None, 'no_position')]
    assert len(pending) == 2


def test_flush_resolves_embeddings_with_positions_and_drops_the_others() -> None:
    pending = PendingEmbeddings(CONFIG)
    position(pending, 1.0), position(pending, 2.0)
    for seconds in (5.0, 1.5, 6.0):
        pending.add_embedding(at(seconds))
    assert outcome(pending.flush()) == [(5.0, None, 'no_position'), (1.5, 15.0, ''), (6.0, None, 'no_position')]
    assert pending.flush() == []


def test_a_recording_that_starts_again() -> None:
    pending = PendingEmbeddings(CONFIG)
    position(pending, 100.0)
    pending.add_embedding(at(100.5))
    with pytest.raises(RefusedInput) as refused:
        position(pending, 1.0)
    assert refused.value.cause == 'position_stamp_backwards'
    pending.forget_positions()
    pending.forget_embeddings()
    assert position(pending, 1.0) == []
    pending.add_embedding(at(1.5))
    assert position(pending, 2.0) == [(1.5, 15.0, '')]


def test_a_position_that_is_not_finite_is_refused_and_resolves_nothing() -> None:
    pending = PendingEmbeddings(CONFIG)
    pending.add_embedding(at(0.5))
    with pytest.raises(RefusedInput) as refused:
        pending.add_position(SECOND, Pose(float('nan'), 0.0))
    assert refused.value.cause == 'invalid_position'
    assert len(pending) == 1


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.integers(0, 40)), max_size=40))
def test_every_embedding_is_resolved_once_in_order_and_only_between_positions(events: list[tuple[bool, int]]) -> None:
    pending = PendingEmbeddings(CONFIG)
    arrived: list[int] = []
    resolved: list[Resolved] = []
    known: list[int] = []
    for is_position, half_seconds in events:
        stamp = half_seconds * SECOND // 2
        if not is_position:
            arrived.append(stamp)
            resolved += pending.add_embedding(at(half_seconds / 2))
        elif not known or stamp > known[-1]:
            known.append(stamp)
            resolved += pending.add_position(stamp, Pose(stamp / SECOND, 0.0))
    resolved += pending.flush()
    assert [one.embedding.stamp_ns for one in resolved] == arrived
    for one in resolved:
        stamp = one.embedding.stamp_ns
        between = stamp in known or any(a < stamp < b and b - a <= 1.5 * SECOND for a, b in itertools.pairwise(known))
        if one.pose:
            assert between and one.cause == ''
            assert one.pose.x_m == pytest.approx(stamp / SECOND, abs=1e-9)
        else:
            assert one.cause == 'no_position'


def test_the_number_of_waiting_embeddings_is_bounded_though_their_stamps_are_equal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('offradar_ros.mapping.pending.MAX_WAITING', 20)
    waiting = PendingEmbeddings(CONFIG)
    dropped = [one for _ in range(1000) for one in outcome(waiting.add_embedding(at(1.0)))]
    assert len(waiting) == 20
    assert dropped == [(1.0, None, 'too_many_waiting')] * 980
    assert len(waiting.flush()) == 20


@pytest.mark.parametrize('signature', [b'', b'x' * 100])
def test_the_memory_of_waiting_embeddings_is_bounded(monkeypatch: pytest.MonkeyPatch, signature: bytes) -> None:
    one = dataclasses.replace(at(1.0), signature=signature)
    monkeypatch.setattr('offradar_ros.mapping.pending.MAX_WAITING_BYTES', 5 * (2 * one.mean.nbytes + len(signature)))
    waiting = PendingEmbeddings(CONFIG)
    for forget in (waiting.flush, waiting.forget_embeddings):
        dropped = [cause for _ in range(12) for *_, cause in outcome(waiting.add_embedding(one))]
        assert (len(waiting), dropped) == (5, ['too_many_waiting'] * 7)
        forget()
