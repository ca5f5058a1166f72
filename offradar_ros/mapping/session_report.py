"""Reports of what a session, or its undo, changed in the map."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any


@dataclasses.dataclass(frozen=True)
class SessionReport:
    """Merge report of one session.

    Attributes:
        session_id: id of the session.
        name: name of the session.
        inserted: scans that became places.
        replaced: scans that replaced the content of at least one place.
        kept: scans that left the map unchanged.
        dropped: scans that did not reach the map, by cause.
        places_before: places when the session started.
        places_after: places when it ended.
        mean_uncertainty_before: mean U over the places when it started; NaN for an empty map.
        mean_uncertainty_after: mean U over the places when it ended.
    """

    session_id: int
    name: str
    inserted: int
    replaced: int
    kept: int
    dropped: Mapping[str, int]
    places_before: int
    places_after: int
    mean_uncertainty_before: float
    mean_uncertainty_after: float

    def summary(self) -> str:
        """The report as one line of text."""
        dropped = ', '.join(f'{count} {cause}' for cause, count in sorted(self.dropped.items()))
        return (
            f'{session_label(self.session_id, self.name)}: {self.inserted} inserted, {self.replaced} replaced, '
            f'{self.kept} kept, {sum(self.dropped.values())} dropped{f" ({dropped})" if dropped else ""}; '
            f'places {self.places_before} -> {self.places_after}, mean U '
            f'{_number(self.mean_uncertainty_before)} -> {_number(self.mean_uncertainty_after)}'
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain values under the attributes' names, fit for JSON; an unknown mean U is None."""
        values = dataclasses.asdict(self) | {'dropped': dict(self.dropped)}
        return {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in values.items()}


@dataclasses.dataclass(frozen=True)
class UndoReport:
    """What an undo changed; `was_running` if the session was discarded while it ran, not undone after its end."""

    session_id: int
    name: str
    was_running: bool
    removed: int
    restored: int
    places_after: int

    def __str__(self) -> str:
        return (
            f'{session_label(self.session_id, self.name)} {"discarded" if self.was_running else "undone"}: '
            f'{self.removed} places removed, {self.restored} restored; {self.places_after} places'
        )


def _number(value: float) -> str:
    return 'none' if math.isnan(value) else f'{value:.3f}'


def session_label(session_id: int, name: str) -> str:
    """A session's id and name, for messages."""
    return f'session {session_id} ({name})' if name else f'session {session_id}'
