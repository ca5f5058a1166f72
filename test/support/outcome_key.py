"""What two ways of answering the same scans must agree on."""

from __future__ import annotations

from typing import Any

from offradar_ros.types import Match, Outcome


def key(outcome: Outcome) -> tuple[Any, ...]:
    """The part of an outcome that must be equal to the last bit, whether nodes or `drive` made it."""
    kind = 'match' if isinstance(outcome, Match) else outcome.reason.value
    alignments = [c.alignment and (c.alignment.score, *c.alignment.pose.tolist()) for c in outcome.candidates]
    found = tuple((c.place_id, c.distance, c.uncertainty) for c in outcome.candidates), tuple(alignments)
    return (
        outcome.stamp_ns,
        kind,
        outcome.uncertainty,
        outcome.threshold,
        found,
        repr(outcome.p_right),
        outcome.evidence,
    )
