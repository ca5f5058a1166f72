"""The content of a map file, as records."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.place_columns import PlaceColumns, take_rows
from offradar_ros.mapping.schema import VERSION
from offradar_ros.mapping.seal import Seal
from offradar_ros.types import Place, PlaceTable, ScanKey

Before = dict[int, Place | None]
"""Content, before a session, of the places that it changed, by place id; None for places that did not exist."""


@dataclasses.dataclass(frozen=True)
class StoredSession:
    """One row of the sessions table; `report` is the merge report as a mapping, `state` as in the schema."""

    session_id: int
    name: str
    stamp_ns: int
    state: str
    report: Mapping[str, Any]


@dataclasses.dataclass(frozen=True, eq=False)
class StoredMap:
    """A map file's content.

    Attributes:
        model: model of the embeddings; None for a map that never held any.
        origin: origin of the local frame; None if it is not known yet.
        next_place_id: id of the next new place.
        columns: every place, including changes of a session that was saved but not ended; `places` is a view of it.
        anchors_m: (N, 2) float64, east and north where each place was first mapped.
        sessions: every session, oldest first.
        before: for each session that can be undone, the content of its places before it.
        signatures: of the scans that `places` and `before` hold, as far as they have one.
        version: of the file's format.
        seal: what identifies this content of the file; None for a file of version 1, and for content not yet written.
        is_log_foreign: whether a log lies beside the file that does not belong to it, and was not read.
    """

    model: ModelInfo | None
    origin: GeoPoint | None
    next_place_id: int
    columns: PlaceColumns
    anchors_m: NDArray[np.float64]
    sessions: tuple[StoredSession, ...]
    before: Mapping[int, Before]
    signatures: Mapping[ScanKey, bytes] = dataclasses.field(default_factory=dict)
    version: int = VERSION
    seal: Seal | None = None
    is_log_foreign: bool = False

    @property
    def places(self) -> PlaceTable:
        """Every place, in ascending order of id, including changes of a session that was saved but not ended."""
        return self.columns.table

    def committed(self) -> PlaceTable:
        """The map as of the last ended session."""
        running = [session.session_id for session in self.sessions if session.state == 'running']
        return revert(self.places, self.before.get(running[-1], {})) if running else self.places


def revert(places: PlaceTable, before: Before) -> PlaceTable:
    """A copy of `places` (in ascending order of id) with the content `before` restored."""
    new = [place_id for place_id, place in before.items() if place is None]
    old = [place for place in before.values() if place is not None]
    reverted = take_rows(places, np.flatnonzero(~np.isin(places.place_ids, new)))
    restored = PlaceTable.from_places(old, places.means.shape[1])
    rows = np.searchsorted(reverted.place_ids, restored.place_ids)
    for field in dataclasses.fields(PlaceTable):
        getattr(reverted, field.name)[rows] = getattr(restored, field.name)
    return reverted
