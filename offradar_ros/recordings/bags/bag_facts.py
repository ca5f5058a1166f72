"""What a bag holds, by its messages themselves: not by what its tables and metadata.yaml say."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable

Topic = tuple[str, str]
"""Name and message type."""


@dataclasses.dataclass(frozen=True)
class BagFacts:
    """Messages of a bag.

    Attributes:
        counts: number of messages of each topic that has any.
        start_ns: earliest log time; 0 without messages.
        end_ns: just after the latest log time; 0 without messages.
    """

    counts: Counter[Topic]
    start_ns: int
    end_ns: int


def joined(parts: Iterable[BagFacts]) -> BagFacts:
    """The facts of all files of a bag."""
    filled = [part for part in parts if part.counts]
    if not filled:
        return BagFacts(Counter(), 0, 0)
    counts: Counter[Topic] = sum((part.counts for part in filled), Counter())
    return BagFacts(counts, min(part.start_ns for part in filled), max(part.end_ns for part in filled))
