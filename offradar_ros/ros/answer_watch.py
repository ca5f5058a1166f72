"""Whether the query node still finds anything, and if not, why."""

from __future__ import annotations

from collections.abc import Mapping

from offradar_ros.ros.diagnostics import Trouble
from offradar_ros.types import Reason

REJECTED = 20
"""Rejections in a row that are worth a word."""
WRONG_MODEL = 3
"""Of another model, a few are enough: the next will not be better."""
REMEDIES = {
    Reason.UNCERTAIN: 'U of every scan is above the threshold: calibrate for this sensor (offradar calibrate), and '
    'look at the scans',
    Reason.UNKNOWN_PLACE: 'the vehicle is off the map, or the scans are not as those of the map: compare the range '
    'resolution and the azimuths',
    Reason.AMBIGUOUS: 'the places of this map resemble one another: see localisation, which joins many scans',
    Reason.UNVERIFIED: 'the scans do not agree with those of the places they resemble: the vehicle is off the map, or '
    'the map was made with a radar that is mounted or set otherwise (query.verify: false leaves alignments out)',
    Reason.INVALID_EMBEDDING: 'the encoder refuses the scans: see its diagnostics',
    Reason.MAP_EMPTY: 'no session has ended: call map_server/end_session after a drive with positions',
    Reason.WRONG_MODEL: 'the map and the encoder are of different models: start the encoder with the parameters that '
    'the map was made with, or use another map',
}
PREFIX = 'rejected.'


class AnswerWatch:
    """Rejections since the last match, from the counts of the node: `matched` and `rejected.REASON`."""

    def __init__(self) -> None:
        self._matched = 0
        self._before: dict[str, int] = {}

    def trouble(self, counts: Mapping[str, int]) -> Trouble | None:
        """Why everything is rejected; None while something is found, or too little was asked."""
        rejected = {name: count for name, count in counts.items() if name.startswith(PREFIX)}
        if counts.get('matched', 0) != self._matched:
            self._matched, self._before = counts.get('matched', 0), rejected
        since = {name: count - self._before.get(name, 0) for name, count in rejected.items()}
        total = sum(since.values())
        if not total:
            return None
        reason = Reason(max(since, key=lambda name: since[name]).removeprefix(PREFIX))
        if total < (WRONG_MODEL if reason is Reason.WRONG_MODEL else REJECTED):
            return None
        text = f'the last {total} scans were all rejected, mostly as {reason.value}: {REMEDIES[reason]}'
        return Trouble('all_rejected', text, is_error=reason is Reason.WRONG_MODEL)
