"""The second stage: embeddings and positions in, map updates out."""

from __future__ import annotations

import collections
import dataclasses
import enum
import math
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from offradar_ros.alignment.signature_code import checksum_of
from offradar_ros.config import Config
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError, RefusedInput
from offradar_ros.geometry import GeoPoint, LeftOut
from offradar_ros.mapping.pending import Resolved
from offradar_ros.mapping.session_report import SessionReport, UndoReport
from offradar_ros.mapping.sessions import OtherModelError, SessionMap
from offradar_ros.positions.motion import positions_apart_m
from offradar_ros.positions.rules import geo_point, require_pose
from offradar_ros.stages.map_frame import MapFrame
from offradar_ros.stages.positioning import Positioning
from offradar_ros.types import Embedding, PlaceTable, Pose, ScanKey

MAX_MESSAGE_PLACES = 50_000
"""Largest map that is sent as a message: for a larger one the query node reads the file."""
POSITION_GAP_S = 0.5
"""A session that ends does not wait for positions if the last one arrived longer ago than this, and than one and a half
times the pause before it, up to `position.max_gap_s`."""
MAX_WAITING_FOR_MODEL = 64
"""Most embeddings that wait for their model, whose latched message may arrive after them."""


@dataclasses.dataclass(frozen=True)
class MapUpdate:
    """What one embedding changed in the map.

    Attributes:
        stamp_ns: stamp of the embedding.
        changed: the places that were inserted or replaced with it; may be empty.
        signature: that of the embedding, which all of them hold now; empty if it has none.
        problem: why it was not merged, or None.
    """

    stamp_ns: int
    changed: PlaceTable
    signature: bytes = b''
    problem: RefusedInput | None = None


class Form(enum.Enum):
    """How the committed map is published."""

    WHOLE = 'whole'
    FILE = 'file'
    CHANGES = 'changes'


@dataclasses.dataclass(frozen=True)
class CommittedMap:
    """The map as of the last ended session, in the form in which it is published.

    Attributes:
        form: WHOLE: every place. FILE: the map is too large for a message and is read from its file. CHANGES: the file
            was read before, and only the changes of the last session are sent.
        table: the places to publish; empty for FILE.
        checksums: of WHOLE, those of the signatures of the scans that the places hold, 0 for a scan that has none.
    """

    form: Form
    table: PlaceTable
    checksums: tuple[int, ...] = ()


class MapStage:
    """Embeddings and positions in, map updates out, each embedding once and in order of arrival.

    Args:
        config: `position` and `map` are used.
        session_map: the map into which embeddings are merged.
        clock: monotonic time in seconds, for `map.autosave_s` and the gap between positions.
    """

    def __init__(self, config: Config, session_map: SessionMap, clock: Callable[[], float] = time.monotonic) -> None:
        self.map = session_map
        self._clock = clock
        self._positioning: Positioning[GeoPoint | Pose] = Positioning(config.position, self._placed, positions_apart_m)
        self._waiting_for_model: collections.deque[Embedding] = collections.deque()
        self._frame = MapFrame(session_map.origin)
        self._discarded = False
        self._not_moved = ''
        self._autosave_s = config.map.autosave_s if config.map.path else 0.0
        self._max_gap_s = config.position.max_gap_s
        self._position_s, self._position_pause_s = -math.inf, 0.0
        self._saved_s = clock()
        self._changed_since_view = False
        self._file_is_read = False
        self._changed: PlaceTable | None = None

    def adopt_model(self, info: ModelInfo) -> list[MapUpdate]:
        """Accept embeddings of this model from now on; maps those that waited for it first.

        RefusedInput: `wrong_model`, the map holds embeddings of another; `not_saved`, the file cannot be written.
        """
        try:
            self.map.adopt_model(info)
        except OtherModelError as error:
            raise RefusedInput('wrong_model', str(error)) from error
        except MapError as error:
            raise RefusedInput('not_saved', str(error)) from error
        waiting = list(self._waiting_for_model)
        self._waiting_for_model.clear()
        return [update for embedding in waiting for update in self.add_embedding(embedding)]

    def add_point(self, stamp_ns: int, point: GeoPoint) -> list[MapUpdate]:
        """Add a geodetic position. The origin of an empty map is one that most positions of its first drive are near.

        RefusedInput as `geo_point` and `PositionOrder.add`. Those that do not count for another reason, as for being
        farther than `FAR_M` from the origin, are told of by `take_left_out`.
        """
        self._note_arrival()
        point = geo_point(*dataclasses.astuple(point))
        return self._merged(self._positioning.add_position(stamp_ns, point))

    def add_pose(self, stamp_ns: int, pose: Pose) -> list[MapUpdate]:
        """Add a pose in the map frame, with its heading or without; RefusedInput if it is invalid or not newer than the
        last. `position.heading` says whether the heading is used.
        """
        self._note_arrival()
        return self._merged(self._positioning.add_position(stamp_ns, require_pose(pose)))

    def _note_arrival(self) -> None:
        now_s = self._clock()
        self._position_s, self._position_pause_s = now_s, now_s - self._position_s

    def _placed(self, stamp_ns: int, position: GeoPoint | Pose) -> Sequence[tuple[int, Pose]]:
        if isinstance(position, Pose):
            return [(stamp_ns, position)]
        pose, left_out = self._frame.place(stamp_ns, position)
        for held_before in left_out:
            self._positioning.leave_out(held_before)
        if pose is not None:
            return [(stamp_ns, pose)]
        return self._moved() if self._frame.is_outvoted else []

    def _moved(self) -> Sequence[tuple[int, Pose]]:
        """Move the origin; nothing while what was mapped around the wrong one cannot be discarded."""
        self._not_moved = ''
        if self.map.origin is not None:
            try:
                self.map.restart_session('far_position')
            except MapError as error:
                self._not_moved = f'what was mapped around a wrong fix cannot be discarded, so nothing is: {error}'
                return []
            self._discarded = True
        self._positioning.forget_positions()
        poses, left_out = self._frame.move()
        self._positioning.leave_out(left_out)
        return poses

    def take_left_out(self) -> list[LeftOut]:
        """Positions that do not count, though they were not refused when they came; each is told of once."""
        return self._positioning.take_left_out()

    def take_discarded(self) -> bool:
        """Whether, since the last call, what was mapped of the running session was discarded: publish the map again."""
        discarded, self._discarded = self._discarded, False
        return discarded

    def problem(self) -> str:
        """What keeps positions out of the map, and what to do; empty if nothing does."""
        return self._not_moved or self._frame.problem()

    def heading_problem(self) -> str:
        """What is wrong with the headings that come with positions, and what is done; empty if nothing is."""
        return self._positioning.heading_problem

    def add_embedding(self, embedding: Embedding) -> list[MapUpdate]:
        """Add an embedding of the running session; it is merged as soon as its model and position are known.

        Without a session it is neither mapped nor counted.
        """
        if self.map.running_session_id is None:
            return []
        if not len(embedding.mean):
            problem = RefusedInput(
                'invalid_embedding', f'scan {embedding.stamp_ns} ns could not be encoded: not mapped'
            )
            return [self._refused(embedding, problem)]
        if self.map.model is None:
            self._waiting_for_model.append(embedding)
            return self._drop_waiting_for_model(MAX_WAITING_FOR_MODEL)
        try:
            self.map.check(embedding)
        except RefusedInput as refused:
            # Before it takes a place in the queue, or its stamp counts as that of a scan.
            return [self._refused(embedding, refused)]
        return self._merged(self._positioning.add_scan(embedding))

    @property
    def scans(self) -> int:
        """Number of scans so far that had to have a position."""
        return self._positioning.scans

    def expects_positions(self, scans: int) -> bool:
        """Whether any of the first `scans` scans waits for a position, and positions still arrive.

        A session that ended now would drop them. Others, which came later, always wait where positions come late.
        """
        gap_s = max(POSITION_GAP_S, min(1.5 * self._position_pause_s, self._max_gap_s))
        return self._positioning.waits(scans) and self._clock() - self._position_s < gap_s

    def flush(self) -> list[MapUpdate]:
        """Merge or drop every waiting scan, as when no later model or position will arrive."""
        updates = [*self._drop_waiting_for_model(0), *self._merged(self._positioning.flush())]
        for left_out in self._frame.take_far():
            self._positioning.leave_out(left_out)
        return updates

    def start_session(self, stamp_ns: int) -> str:
        """Start a session at this stamp, or continue a running one without scans; returns what was done.

        MapError while a session with scans runs.
        """
        running = self.map.running_session_id
        if running is not None and self.map.is_session_empty:
            return f'session {running} runs already and is empty: it continues'
        return f'session {self.map.start_session("", stamp_ns)} started'

    def end_session(self) -> tuple[list[MapUpdate], SessionReport]:
        """Merge or drop every waiting scan, then commit the running session; MapError if that fails."""
        updates = self.flush()
        changed = self.map.running() if self._file_is_read else None
        report = self.map.end_session()
        if self.map.origin is not None:
            self._frame.settle()
        self._changed = changed
        return updates, report

    def undo_session(self) -> UndoReport:
        """Discard the running session with its waiting scans, or else undo the session that ended last."""
        self._forget_waiting()
        report = self.map.undo_session()
        self._forget_origin()
        return report

    def clear(self) -> Path | None:
        """Empty the map and drop the waiting scans; returns the path of the copy, as `SessionMap.clear`."""
        self._forget_waiting()
        copy = self.map.clear()
        self._forget_origin()
        return copy

    def save(self) -> bool:
        """Write the changes of the running session to disk, and the whole map where its file was removed.

        Returns whether it was. MapError if that fails or the map has no file.
        """
        is_whole = self.map.save(again=True)
        self._saved_s = self._clock()
        return is_whole

    def autosave(self) -> None:
        """Save the running session if the last save is `map.autosave_s` ago; call it often.

        RefusedInput('not_saved') if the file cannot be written; the next attempt is `map.autosave_s` later.
        """
        if not self._autosave_s or self.map.running_session_id is None:
            return
        if self._clock() - self._saved_s < self._autosave_s:
            return
        self._saved_s = self._clock()
        try:
            # Where the file was removed, whoever did so decides: they may want an empty map.
            self.map.save()
        except MapError as error:
            raise RefusedInput('not_saved', str(error)) from error

    def committed(self) -> CommittedMap | None:
        """What to publish after a session has ended or the map has changed otherwise; None without a model."""
        changed, self._changed = self._changed, None
        if not self.map.model:
            return None
        is_large = len(self.map) > MAX_MESSAGE_PLACES
        if is_large and self._file_is_read and changed is not None:
            return CommittedMap(Form.CHANGES, changed)
        self._file_is_read = is_large
        if is_large:
            return CommittedMap(Form.FILE, PlaceTable.from_places([], self.map.dimension))
        table = self.map.committed()
        scans = table.scans()
        signatures = self.signatures(scans)
        return CommittedMap(Form.WHOLE, table, tuple(checksum_of(signatures[scan]) for scan in scans))

    def signatures(self, scans: Sequence[ScanKey]) -> dict[ScanKey, bytes]:
        """The signature of each of these scans, empty for one that has none or is not in the map."""
        held = self.map.signatures.read(scans)
        return {scan: held.get(scan, b'') for scan in scans}

    def changed_view(self) -> PlaceTable | None:
        """Every place; None if nothing changed since the last call, or if the map is too large for a message."""
        if not self._changed_since_view or len(self.map) > MAX_MESSAGE_PLACES:
            return None
        self._changed_since_view = False
        return self.map.places()

    def _forget_waiting(self) -> None:
        self._waiting_for_model.clear()
        self._positioning.forget_scans()

    def _forget_origin(self) -> None:
        """Where the map has none any more, the next positions decide."""
        if self.map.origin is None:
            self._frame, self._not_moved = MapFrame(None), ''
            self._positioning.forget_positions()

    def _drop_waiting_for_model(self, kept: int) -> list[MapUpdate]:
        """Drop the oldest embeddings that wait for their model until `kept` are left."""
        updates = []
        while len(self._waiting_for_model) > kept:
            embedding = self._waiting_for_model.popleft()
            problem = RefusedInput('no_model', f'scan {embedding.stamp_ns} ns: its model is not known: not mapped')
            updates.append(self._refused(embedding, problem))
        return updates

    def _merged(self, resolved: Iterable[Resolved]) -> list[MapUpdate]:
        return [self._merge(item) for item in resolved]

    def _merge(self, resolved: Resolved) -> MapUpdate:
        embedding = resolved.embedding
        if resolved.pose is None:
            waits = 'no position at the stamp of' if resolved.cause == 'no_position' else 'too many scans wait with'
            problem = RefusedInput(resolved.cause, f'{waits} scan {embedding.stamp_ns} ns: not mapped')
            return self._refused(embedding, problem)
        try:
            if self._frame.origin and self.map.running_session_id is not None:
                self.map.set_origin(self._frame.origin)
            merge = self.map.merge(embedding, resolved.pose)
        except RefusedInput as refused:
            return self._refused(embedding, refused)
        changed = self.map.changed(merge)
        self._changed_since_view = self._changed_since_view or len(changed) > 0
        return MapUpdate(embedding.stamp_ns, changed, embedding.signature)

    def _refused(self, embedding: Embedding, problem: RefusedInput) -> MapUpdate:
        self.map.count_dropped(problem.cause)
        return MapUpdate(embedding.stamp_ns, PlaceTable.from_places([], self.map.dimension), problem=problem)
