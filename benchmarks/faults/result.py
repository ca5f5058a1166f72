"""What a campaign is asked for and what it reports."""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Iterable
from pathlib import Path

MOST_EXAMPLES = 5
"""Failures that a result quotes; the others are only counted."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """What is asked of every campaign.

    Attributes:
        folder: an empty folder for its files.
        seed: every random choice comes from it.
        scale: share of the full number of tries.
        soak_s: seconds of the soak at full scale.
    """

    folder: Path
    seed: int = 1
    scale: float = 1.0
    soak_s: float = 60.0

    def tries(self, full: int) -> int:
        """The number of tries for one that is `full` at full scale; at least one."""
        return max(1, round(full * self.scale))


@dataclasses.dataclass(frozen=True)
class Result:
    """The outcome of many tries of one kind.

    Attributes:
        campaign: name of the campaign.
        kind: what was done to what.
        tries: how often.
        refused: tries that ended in an error of one line.
        same: tries after which all was as it should be.
        differences: tries that ended silently with something else.
        crashes: tries that ended a process, ran out of time or memory, or raised an unknown error.
        losses: what was acknowledged or sent, and is neither there nor counted.
        seconds: time that the tries took.
        figures: further measurements, by name with unit.
        examples: some of the failures, each with the number of its try.
    """

    campaign: str
    kind: str
    tries: int
    refused: int = 0
    same: int = 0
    differences: int = 0
    crashes: int = 0
    losses: int = 0
    seconds: float = 0.0
    figures: dict[str, float] = dataclasses.field(default_factory=dict)
    examples: tuple[str, ...] = ()

    @property
    def failures(self) -> int:
        """Differences, crashes and losses together."""
        return self.differences + self.crashes + self.losses


REFUSED, SAME, DIFFERENT, CRASHED, LOST = 'refused', 'same', 'different', 'crashed', 'lost'


@dataclasses.dataclass(frozen=True)
class Verdict:
    """The outcome of one try: one of the five words above, and what was seen."""

    word: str
    detail: str = ''


def summed(campaign: str, kind: str, verdicts: Iterable[Verdict], seconds: float, **figures: float) -> Result:
    """The result of these tries, numbered from 0."""
    tries = list(verdicts)
    counts = collections.Counter(verdict.word for verdict in tries)
    failed = [
        f'try {number}: {verdict.word}: {verdict.detail}'
        for number, verdict in enumerate(tries)
        if verdict.word not in (REFUSED, SAME)
    ]
    return Result(
        campaign,
        kind,
        len(tries),
        refused=counts[REFUSED],
        same=counts[SAME],
        differences=counts[DIFFERENT],
        crashes=counts[CRASHED],
        losses=counts[LOST],
        seconds=seconds,
        figures=figures,
        examples=tuple(failed[:MOST_EXAMPLES]),
    )
