"""A query node that rejects everything says why."""

from __future__ import annotations

from collections import Counter

import pytest

from offradar_ros.ros.answer_watch import REJECTED, REMEDIES, WRONG_MODEL, AnswerWatch
from offradar_ros.types import Reason


@pytest.mark.parametrize('reason', Reason)
def test_rejections_without_a_match_are_a_trouble(reason: Reason) -> None:
    watch, counts = AnswerWatch(), Counter({'matched': 3, f'rejected.{reason.value}': 100})
    assert watch.trouble(counts) is None
    needed = WRONG_MODEL if reason is Reason.WRONG_MODEL else REJECTED
    counts[f'rejected.{reason.value}'] += needed - 1
    assert watch.trouble(counts) is None
    counts[f'rejected.{reason.value}'] += 1
    trouble = watch.trouble(counts)
    assert trouble is not None
    assert f'the last {needed} scans were all rejected, mostly as {reason.value}: ' in trouble.text
    assert REMEDIES[reason] in trouble.text
    assert trouble.is_error == (reason is Reason.WRONG_MODEL)
    counts['matched'] += 1
    assert watch.trouble(counts) is None


def test_the_most_frequent_reason_counts() -> None:
    counts = Counter({'rejected.uncertain': REJECTED, 'rejected.ambiguous': 1, 'rejected.wrong_model': 2})
    trouble = AnswerWatch().trouble(counts)
    assert trouble is not None
    assert 'mostly as uncertain' in trouble.text


def test_nothing_asked_is_no_trouble() -> None:
    assert AnswerWatch().trouble(Counter()) is None
