"""The parent map over many drives: each is merged as a session that can be ended, saved and undone."""

from __future__ import annotations

import collections
import dataclasses
import math
from pathlib import Path

from offradar_ros.config import MapConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.held_signatures import HeldSignatures
from offradar_ros.mapping.parent_map import Merge, MergeKind, ParentMap
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.mapping.session_report import SessionReport, UndoReport, session_label
from offradar_ros.mapping.store import LostMapError, MapStore
from offradar_ros.mapping.stored_map import Before, StoredMap, StoredSession, revert
from offradar_ros.types import Embedding, PlaceTable, Pose, ScanKey


@dataclasses.dataclass
class _Running:
    """The running session.

    `before` holds the content, at the start of the session, of each place that it changed; `unsaved` the ids of places
    that changed since the last write to disk.
    """

    session_id: int
    name: str
    stamp_ns: int
    places_before: int
    mean_uncertainty_before: float
    before: Before = dataclasses.field(default_factory=dict)
    merges: collections.Counter[MergeKind] = dataclasses.field(default_factory=collections.Counter)
    dropped: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    unsaved: set[int] = dataclasses.field(default_factory=set)
    saved: bool = False


class OtherModelError(MapError):
    """The map holds embeddings of another model."""


class SessionMap:
    """A parent map with sessions, in the file `map.path` or, if that is empty, in memory only.

    Opening raises MapError for a file that cannot be used (see `MapStore.open`). Not thread-safe.
    """

    def __init__(self, config: MapConfig) -> None:
        self.config = config
        self._store: MapStore | None = None
        self._model: ModelInfo | None = None
        # None until this process has one; its first write also ends sessions that another process left running.
        self._adopted: ModelInfo | None = None
        self._origin: GeoPoint | None = None
        self._parent = ParentMap(config, 0)
        self._signatures = HeldSignatures({})
        self._running: _Running | None = None
        self._undoable: list[tuple[StoredSession, Before]] = []
        self._next_session_id = 1
        self._sessions: dict[int, StoredSession] = {}
        if config.path:
            self._store, stored = MapStore.open(Path(config.path))
            self._load(stored)

    def _load(self, stored: StoredMap) -> None:
        self._model, self._origin = stored.model, stored.origin
        self._parent = ParentMap(self.config, stored.model.dimension if stored.model else 0)
        self._parent.load(stored.columns, stored.anchors_m, stored.next_place_id)
        self._signatures = HeldSignatures(stored.signatures)
        self._next_session_id = max((session.session_id for session in stored.sessions), default=0) + 1
        for session in stored.sessions:
            # The first write does the same in the file.
            state = 'interrupted' if session.state == 'running' else session.state
            self._sessions[session.session_id] = dataclasses.replace(session, state=state)
        for session in reversed([session for session in stored.sessions if session.state != 'undone']):
            before = stored.before.get(session.session_id, {})
            changed = session.report['inserted'] + session.report['replaced']
            if (changed and not before) or len(self._undoable) == self.config.undo_depth:
                break
            if changed:
                self._undoable.insert(0, (session, before))
        if not len(self) and not self._undoable:
            self._origin = None

    def close(self) -> None:
        """Close the file. Changes of a running session since its last save are lost."""
        if self._store:
            self._store.close()
            self._store = None

    @property
    def notices(self) -> tuple[str, ...]:
        """What was done to the map file when it was opened, one line each, such as an upgrade."""
        return self._store.notices if self._store else ()

    @property
    def is_file_complete(self) -> bool:
        """Whether a copy of the map file alone is a copy of the map; not while a reader holds the log beside it."""
        return self._store is None or self._store.is_folded

    def require_file(self) -> None:
        """MapError if the map file was removed, replaced or overwritten since it was opened."""
        if self._store:
            self._store.require_ours()

    def rescue(self) -> Path | None:
        """Write the whole map, with the running session as an interrupted one, as a new file; its path.

        It is named ``<path>.rescued-<UTC stamp>.db``. MapError if it cannot be written; None for a map in memory.
        """
        return self._store.rescue(self._content('interrupted')) if self._store else None

    def __enter__(self) -> SessionMap:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        return len(self._parent)

    @property
    def model(self) -> ModelInfo | None:
        """Model of the embeddings in the map; None until one is adopted."""
        return self._model

    def adopt_model(self, info: ModelInfo) -> None:
        """Accept embeddings of this model from now on; OtherModelError if the map holds embeddings of another model.

        One of the same fingerprint and another dimension is another model too: the file could not be read any more.
        """
        is_other = self._model is not None and not self._model.is_same_model(info)
        if self._model and is_other and (len(self) or self._undoable):
            same = self._model.dimension == info.dimension
            dimensions = '' if same else f' (d = {self._model.dimension}, not {info.dimension})'
            raise OtherModelError(
                f'{self._where}: holds embeddings of {self._model.name} {self._model.fingerprint[:12]}, '
                f'not of {info.name} {info.fingerprint[:12]}{dimensions}: '
                'use that model, or another map.path'
            )
        if self._adopted and self._adopted.is_same_model(info):
            # Another name or other metadata is for people, and not worth a write for each message.
            return
        if self._store:
            self._store.write_model(info, except_session=self.running_session_id)
        self._adopted = info
        if not self._model or is_other:
            next_place_id = self._parent.next_place_id
            self._parent = ParentMap(self.config, info.dimension)
            self._parent.next_place_id = next_place_id
        self._model = info

    @property
    def origin(self) -> GeoPoint | None:
        """Origin of the ``map`` frame; None until it is set."""
        return self._origin

    def set_origin(self, origin: GeoPoint) -> None:
        """Set the origin of the ``map`` frame for all drives; MapError if it has another origin already.

        It is written with the first places: a disk that is full must not keep a scan from being mapped.
        """
        if self._origin == origin:
            return
        if self._origin:
            raise MapError(f'{self._where}: the origin of its frame is {self._origin} and cannot become {origin}')
        self._origin = origin

    @property
    def running_session_id(self) -> int | None:
        """Id of the running session, or None."""
        return self._running.session_id if self._running else None

    @property
    def is_session_empty(self) -> bool:
        """Whether no session runs, or the running one has received no scan yet."""
        return self._running is None or not (self._running.merges or self._running.dropped)

    def start_session(self, name: str, stamp_ns: int) -> int:
        """Start a session and return its id; MapError while another runs, and if the map file was taken away."""
        if self._running:
            raise MapError(
                f'{session_label(self._running.session_id, self._running.name)} runs: end it or undo it first'
            )
        self.require_file()
        return self._start(name, stamp_ns)

    def _start(self, name: str, stamp_ns: int) -> int:
        session_id = self._next_session_id
        self._next_session_id += 1
        self._running = _Running(session_id, name, stamp_ns, len(self), self._parent.mean_uncertainty)
        return session_id

    def check(self, embedding: Embedding) -> None:
        """RefusedInput (`no_model`, `wrong_model`, `invalid_embedding`) if `merge` would refuse it at any position."""
        if not self._model:
            raise RefusedInput('no_model', f'embedding at {embedding.stamp_ns} ns: the map has no model yet')
        if embedding.model != self._model.fingerprint:
            raise RefusedInput(
                'wrong_model',
                f'embedding at {embedding.stamp_ns} ns: made by model {embedding.model[:12] or "(none)"}, '
                f'the map holds {self._model.name} {self._model.fingerprint[:12]}',
            )
        self._parent.check(embedding)

    def merge(self, embedding: Embedding, pose: Pose) -> Merge:
        """Merge one scan of the running session into the map, by Algorithm 1.

        Raises RefusedInput: `no_session`, and those of `check` and `ParentMap.merge`. The caller counts refusals with
        `count_dropped`, together with scans that were dropped before.
        """
        running = self._running
        if not running:
            raise RefusedInput(
                'no_session', f'embedding at {embedding.stamp_ns} ns: no session runs, nothing is mapped'
            )
        self.check(embedding)
        merge = self._parent.merge(embedding, pose, running.session_id)
        running.merges[merge.kind] += 1
        if merge.kind is MergeKind.INSERTED:
            running.before[merge.place_ids[0]] = None
        for place in merge.before:
            running.before.setdefault(place.place_id, place)
        running.unsaved.update(merge.place_ids)
        if merge.place_ids:
            self._signatures.put(ScanKey(running.session_id, embedding.stamp_ns), embedding.signature)
            if self._signatures.is_check_due:
                before = [running.before, *(of_session for _, of_session in self._undoable)]
                self._signatures.keep(self._signatures.needed(self._parent.view, before), is_written=False)
        return merge

    def count_dropped(self, cause: str) -> None:
        """Count a scan of the running session that did not reach the map; does nothing without a session."""
        if self._running:
            self._running.dropped[cause] += 1

    def end_session(self) -> SessionReport:
        """End the running session and write it to disk. MapError if none runs or it cannot be written.

        A session without scans is not stored, and one without changes does not count among those that can be undone.
        """
        running = self._require_running()
        report = self._report(running)
        if self.is_session_empty and not running.saved:
            self._running = None
            return report
        session = StoredSession(running.session_id, running.name, running.stamp_ns, 'ended', report.as_dict())
        undoable = [*self._undoable, (session, running.before)] if running.before else self._undoable
        undoable = undoable[max(0, len(undoable) - self.config.undo_depth) :]
        self._write(session, running, undoable)
        self._undoable, self._running = undoable, None
        return report

    def save(self, *, again: bool = False) -> bool:
        """Write the changes of the running session to disk, in case the process ends before the session does.

        A stored session without an end is interrupted: its changes stay and can be undone. Where the file was removed,
        `again` writes the whole map there and returns true; otherwise that is an error, as is a file that was replaced.
        """
        if not self._store:
            raise MapError('map.path is empty: this map is kept in memory only and cannot be saved')
        try:
            self._store.require_ours()
        except LostMapError:
            if not again:
                raise
            content = self._content('running')
            self._store.write_again(content)
            self._signatures.keep(content.signatures, is_written=True)
            if self._running and not self.is_session_empty:
                self._running.unsaved.clear()
                self._running.saved = True
            return True
        running = self._running
        if running and not self.is_session_empty:
            report = self._report(running).as_dict()
            session = StoredSession(running.session_id, running.name, running.stamp_ns, 'running', report)
            self._write(session, running, [*self._undoable, (session, running.before)])
            running.saved = True
        return False

    def undo_session(self) -> UndoReport:
        """Discard the running session, or else undo the one that ended last; MapError if there is none."""
        running = self._running
        if running:
            session = StoredSession(running.session_id, running.name, running.stamp_ns, 'undone', {})
            before = running.before
        elif self._undoable:
            session, before = self._undoable[-1]
            session = dataclasses.replace(session, state='undone')
        else:
            raise MapError(f'{self._where}: no session to undo (map.undo_depth is {self.config.undo_depth})')
        old = [place for place in before.values() if place]
        new = [place_id for place_id, place in before.items() if place is None]
        undoable = self._undoable if running else self._undoable[:-1]
        # An empty map has no origin: that of a drive that was undone may have been a wrong fix.
        origin = self._origin if undoable or len(self) > len(new) else None
        if self._store and (running is None or running.saved):
            anchors_m = self._parent.anchors([place.place_id for place in old])
            self._store.undo_session(session, before, anchors_m, origin)
        if running is None or running.saved:
            self._sessions[session.session_id] = session
        self._parent.restore(old)
        self._parent.remove(new)
        self._signatures.forget_session(session.session_id)
        self._running, self._undoable, self._origin = None, undoable, origin
        return UndoReport(session.session_id, session.name, running is not None, len(new), len(old), len(self))

    def clear(self) -> Path | None:
        """Empty the map, after copying its file to ``<path>.<UTC stamp>.bak``; returns the copy's path.

        The model stays. A running session is saved and continues with the empty map, which has no origin. For a map in
        memory there is no copy (None).
        """
        copy = None
        if self._store:
            self.save()
            copy = self._store.clear()
        next_place_id = self._parent.next_place_id
        self._parent = ParentMap(self.config, self._parent.dimension)
        self._parent.next_place_id = next_place_id
        self._signatures.keep({}, is_written=self._store is not None)
        self._undoable, self._sessions, self._origin = [], {}, None
        if self._running:
            running = self._running
            self._running = _Running(running.session_id, running.name, running.stamp_ns, 0, math.nan)
        return copy

    def restart_session(self, cause: str) -> None:
        """Discard what the running session mapped, as when its frame was wrong, and go on with it under another id.

        Its scans count as dropped by `cause`. MapError without a session, and if the file cannot be written: then
        nothing has changed.
        """
        running = self._require_running()
        self.require_file()
        self.undo_session()
        self._start(running.name, running.stamp_ns)
        dropped = running.dropped + collections.Counter({cause: running.merges.total()})
        self._require_running().dropped.update(dropped)

    def committed(self) -> PlaceTable:
        """The places as of the last ended session, in ascending order of id: what queries search."""
        return revert(self._parent.view, self._running.before) if self._running else self._parent.table()

    def running(self) -> PlaceTable:
        """The places that the running session changed, with their present content."""
        return self._parent.rows(sorted(self._running.before) if self._running else [])

    def places(self) -> PlaceTable:
        """Every place, including changes of the running session."""
        return self._parent.table()

    @property
    def dimension(self) -> int:
        """Embedding dimension d of the map's model; 0 without a model."""
        return self._parent.dimension

    def changed(self, merge: Merge) -> PlaceTable:
        """The places that a merge changed, with their present content."""
        return self._parent.rows(merge.place_ids)

    @property
    def signatures(self) -> HeldSignatures:
        """Signatures of scans: at least of all that places hold, or held before sessions that can be undone."""
        return self._signatures

    @property
    def mean_uncertainty(self) -> float:
        """Mean U over all places, including those of the running session; NaN for an empty map."""
        return self._parent.mean_uncertainty

    @property
    def _where(self) -> str:
        return self.config.path or 'the map in memory'

    def _require_running(self) -> _Running:
        if not self._running:
            raise MapError('no session runs: start one first')
        return self._running

    def _report(self, running: _Running) -> SessionReport:
        return SessionReport(
            session_id=running.session_id,
            name=running.name,
            inserted=running.merges[MergeKind.INSERTED],
            replaced=running.merges[MergeKind.REPLACED],
            kept=running.merges[MergeKind.KEPT],
            dropped=dict(running.dropped),
            places_before=running.places_before,
            places_after=len(self),
            mean_uncertainty_before=running.mean_uncertainty_before,
            mean_uncertainty_after=self._parent.mean_uncertainty,
        )

    def _write(self, session: StoredSession, running: _Running, undoable: list[tuple[StoredSession, Before]]) -> None:
        needed = self._signatures.needed(self._parent.view, [before for _, before in undoable])
        if self._store:
            ids = sorted(running.unsaved)
            self._store.write_session(
                session,
                changed=self._parent.rows(ids),
                anchors_m=self._parent.anchors(ids),
                before={place_id: running.before[place_id] for place_id in ids},
                next_place_id=self._parent.next_place_id,
                origin=self._origin,
                undoable=[kept.session_id for kept, _ in undoable],
                signatures=self._signatures.changes(needed),
            )
            running.unsaved.clear()
        self._signatures.keep(needed, is_written=self._store is not None)
        self._sessions[session.session_id] = session

    def _content(self, state: str) -> StoredMap:
        """The whole map, with the running session in this state."""
        sessions, undoable = dict(self._sessions), self._undoable
        if self._running and not self.is_session_empty:
            running = self._running
            report = self._report(running).as_dict()
            session = StoredSession(running.session_id, running.name, running.stamp_ns, state, report)
            sessions[session.session_id] = session
            undoable = [*undoable, (session, running.before)]
        places, before = self._parent.view, {session.session_id: before for session, before in undoable if before}
        columns = PlaceColumns(self.dimension, len(places))
        columns.upsert(places)
        return StoredMap(
            model=self._model,
            origin=self._origin,
            next_place_id=self._parent.next_place_id,
            columns=columns,
            anchors_m=self._parent.anchors(places.place_ids.tolist()),
            sessions=tuple(sessions[session_id] for session_id in sorted(sessions)),
            before=before,
            signatures=self._signatures.needed(places, before.values()),
        )
