"""A refusal may repeat what a message held, and still is of bounded length."""

from __future__ import annotations

from offradar_ros.errors import LONGEST_REFUSAL, RefusedInput


def test_a_refusal_is_cut_in_its_middle() -> None:
    assert str(RefusedInput('cause', 'x' * LONGEST_REFUSAL)) == 'x' * LONGEST_REFUSAL
    refusal = RefusedInput('wrong_encoding', f'image has encoding {"é" * 10**7}: expected mono8')
    assert len(str(refusal)) < LONGEST_REFUSAL + 10
    assert str(refusal).startswith('image has encoding éé')
    assert str(refusal).endswith('é: expected mono8')
    assert refusal.cause == 'wrong_encoding'
