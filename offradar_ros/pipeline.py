"""The way of a scan, stage by stage: encode, map, query.

The live nodes, the replay and the command line all drive these stages and nothing else, so that they give the same
answer on the same recording.
"""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.bags.reader import Bag, RawMessage, scan_topic
from offradar_ros.bags.records import point_from_fix, pose_from_odometry, scan_from_image, stamp_ns
from offradar_ros.bags.topics import FIX, FIX_TYPE, ODOMETRY, ODOMETRY_TYPE
from offradar_ros.config import Config
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame
from offradar_ros.mapping.pending import PendingEmbeddings, Settled
from offradar_ros.mapping.session_report import SessionReport, UndoReport
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.radar.stamps import StampGate
from offradar_ros.retrieval.introspective_query import IntrospectiveQuery
from offradar_ros.types import Embedding, Outcome, PlaceTable, PolarScan, Pose

MAX_EXTENT_M = 100_000.0
"""A flat frame is no map beyond this."""


@dataclasses.dataclass(frozen=True)
class Encoded:
    """What became of one image.

    Attributes:
        embedding: None only for the last scan again, which was answered already; invalid (d = 0) for one that cannot
            be encoded or comes out of order, so that every scan gets exactly one answer.
        problem: why the scan was refused, or None.
        restarted: the stamps jumped back: the recording starts again.
    """

    embedding: Embedding | None
    problem: RefusedInput | None = None
    restarted: bool = False


class EncodeStage:
    """Images in, embeddings out; nothing that is wrong with one scan stops the next."""

    def __init__(self, encoder: Encoder, restart_after_s: float) -> None:
        self.encoder = encoder
        self._gate = StampGate(round(restart_after_s * 1e9))

    def encode(self, stamp: int, decode: Callable[[], PolarScan]) -> Encoded:
        """Embedding of the scan that `decode` gives, which may raise RefusedInput."""
        restarted = False
        try:
            restarted = self._gate.check(stamp)
            return Encoded(self.encoder.encode(decode()), restarted=restarted)
        except RefusedInput as problem:
            if problem.cause == 'repeated_stamp':
                return Encoded(None, problem)
            return Encoded(self._invalid(stamp), problem, restarted)

    def start_recording(self) -> None:
        """Take the next scan as the first of a recording, be it the last scan again."""
        self._gate.forget()

    def _invalid(self, stamp: int) -> Embedding:
        nothing = np.empty(0, np.float32)
        return Embedding(stamp, nothing, nothing, self.encoder.info.fingerprint)


@dataclasses.dataclass(frozen=True)
class MapUpdate:
    """What one embedding did to the map.

    Attributes:
        stamp_ns: of the embedding.
        changed: the rows that the running session inserted or replaced with it; may be empty.
        problem: why it was not merged, or None.
    """

    stamp_ns: int
    changed: PlaceTable
    problem: RefusedInput | None = None


class MapStage:
    """Embeddings and positions in, map updates out, each embedding once and in order of arrival."""

    def __init__(self, config: Config, session_map: SessionMap) -> None:
        self.map = session_map
        self._pending = PendingEmbeddings(config.position)
        self._frame = LocalFrame(session_map.origin) if session_map.origin else None
        self._restart_after_ns = round(config.position.restart_after_s * 1e9)
        self._wait_ns = round(config.position.wait_s * 1e9)
        self._last_scan_ns = 0

    def add_point(self, stamp: int, point: GeoPoint) -> list[MapUpdate]:
        """A geodetic position. The map's frame starts at the first one of the drive whose scan is mapped first.

        RefusedInput('far_position') for one further than `MAX_EXTENT_M` from where the frame starts, such as 0°, 0°.
        """
        frame = self._frame or LocalFrame(point)
        enu = self._enu(frame, point)
        if np.linalg.norm(enu) > MAX_EXTENT_M:
            if self.map.origin:
                kilometres = np.linalg.norm(enu) / 1000.0
                raise RefusedInput(
                    'far_position',
                    f'position {point.latitude_deg:.5f}°, {point.longitude_deg:.5f}° is {kilometres:.0f} km from the '
                    f"map's origin: expected at most {MAX_EXTENT_M / 1000.0:.0f} km",
                )
            # Nothing is mapped yet: it was the first position that was wrong.
            self._pending.forget_positions()
            frame = LocalFrame(point)
            enu = self._enu(frame, point)
        self._frame = frame
        return self.add_pose(stamp, Pose(float(enu[0]), float(enu[1]), float(enu[2])))

    @staticmethod
    def _enu(frame: LocalFrame, point: GeoPoint) -> NDArray[np.float64]:
        lla = np.array([[point.latitude_deg, point.longitude_deg, point.altitude_m]])
        enu: NDArray[np.float64] = frame.to_enu(lla)[0]
        return enu

    def add_pose(self, stamp: int, pose: Pose) -> list[MapUpdate]:
        """A pose in the map frame; RefusedInput if it is invalid or not newer than the last."""
        updates: list[MapUpdate] = []
        last_ns = self._pending.last_position_ns
        if last_ns is not None and last_ns - stamp > self._restart_after_ns:
            updates = self.flush()
            self._pending.clear()
        return updates + self._merged(self._pending.add_position(stamp, pose))

    def add_embedding(self, embedding: Embedding) -> list[MapUpdate]:
        """An embedding, merged as soon as its position is known."""
        if not len(embedding.mean):
            problem = RefusedInput(
                'invalid_embedding', f'scan {embedding.stamp_ns} ns could not be encoded: not mapped'
            )
            return [self._refused(embedding, problem)]
        updates: list[MapUpdate] = []
        if embedding.stamp_ns < self._last_scan_ns:
            # The recording starts again: nothing that still waits will get its position.
            updates = self.flush()
            last_ns = self._pending.last_position_ns
            if last_ns is not None and last_ns - embedding.stamp_ns > self._wait_ns:
                self._pending.forget_positions()
        self._last_scan_ns = embedding.stamp_ns
        return updates + self._merged(self._pending.add_embedding(embedding))

    @property
    def waiting(self) -> int:
        """Embeddings whose position is not known yet."""
        return len(self._pending)

    def flush(self) -> list[MapUpdate]:
        """Settle what still waits: no later position will come for it."""
        return self._merged(self._pending.flush())

    def undo_session(self) -> UndoReport:
        """Take back the running session, with what still waits, or else the one that ended last."""
        self._pending.forget_embeddings()
        return self.map.undo_session()

    def clear(self) -> Path | None:
        """Empty the map, and forget what still waits; returns the copy that was kept."""
        self._pending.forget_embeddings()
        return self.map.clear()

    def end_session(self) -> tuple[list[MapUpdate], SessionReport]:
        """Flush, then commit the running session."""
        return self.flush(), self.map.end_session()

    def _merged(self, settled: Iterable[Settled]) -> list[MapUpdate]:
        return [self._merge(item) for item in settled]

    def _merge(self, settled: Settled) -> MapUpdate:
        embedding = settled.embedding
        if settled.pose is None:
            problem = RefusedInput(
                settled.cause, f'no position within reach of scan {embedding.stamp_ns} ns: not mapped'
            )
            return self._refused(embedding, problem)
        try:
            if self.map.origin is None and self._frame is not None and self.map.running_session_id is not None:
                self.map.set_origin(self._frame.origin)
            merge = self.map.merge(embedding, settled.pose)
        except RefusedInput as refused:
            return self._refused(embedding, refused)
        return MapUpdate(embedding.stamp_ns, self.map.changed(merge))

    def _refused(self, embedding: Embedding, problem: RefusedInput) -> MapUpdate:
        self.map.note_dropped(problem.cause)
        return MapUpdate(embedding.stamp_ns, PlaceTable.from_places([], self.map.dimension), problem)


@dataclasses.dataclass(frozen=True)
class DriveResult:
    """What a drive through the pipeline gave.

    Attributes:
        outcomes: one for each embedding, in order.
        report: of the session that the drive was mapped as, if it was.
        refused: dropped scans and positions by cause.
    """

    outcomes: tuple[Outcome, ...]
    report: SessionReport | None
    refused: Counter[str]


def drive(
    bag: Bag,
    config: Config,
    encoder: Encoder,
    session_map: SessionMap | PlaceTable,
    *,
    session: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DriveResult:
    """Encode, map (if `session` names one) and query every scan of a bag, as the nodes do on the vehicle.

    Queries search the map as of the last ended session; without query.exclude_current_session, the running one too.
    A drive that maps nothing may search a table of places instead, of the encoder's model.
    """
    return _Drive(bag, config, encoder, session_map, session).run(progress or (lambda _done, _total: None))


class _Drive:
    """The three stages on one recording."""

    def __init__(
        self, bag: Bag, config: Config, encoder: Encoder, session_map: SessionMap | PlaceTable, session: str | None
    ) -> None:
        self._bag, self._config = bag, config
        self._fingerprint = encoder.info.fingerprint
        self._encode = EncodeStage(encoder, config.radar.restart_after_s)
        self._query = IntrospectiveQuery(config.query)
        self._mapping: MapStage | None = None
        self._outcomes: list[Outcome] = []
        self._refused: Counter[str] = Counter()
        if isinstance(session_map, PlaceTable):
            self._query.load(session_map, self._fingerprint)
            return
        session_map.adopt_model(encoder.info)
        self._query.load(session_map.committed(), self._fingerprint)
        if session is not None:
            self._mapping = MapStage(config, session_map)
            session_map.start_session(session, bag.start_ns)

    def run(self, progress: Callable[[int, int], None]) -> DriveResult:
        scans = scan_topic(self._bag)
        total = self._bag.counts[scans]
        positions = _position_topics(self._bag, self._config) if self._mapping else []
        for raw in in_lockstep_order(self._bag, scans, positions, self._config.position.max_gap_s):
            message = self._bag.decode(raw)
            try:
                if raw.topic == scans:
                    self._take_scan(message)
                    progress(len(self._outcomes), total)
                elif self._mapping:
                    self._settle(_added_position(self._mapping, raw.msgtype, message))
            except RefusedInput as problem:
                self._refused[problem.cause] += 1
        report = None
        if self._mapping:
            updates, report = self._mapping.end_session()
            self._settle(updates)
        return DriveResult(tuple(self._outcomes), report, self._refused)

    def _take_scan(self, message: Any) -> None:
        decode = functools.partial(scan_from_image, message, self._config.radar)
        encoded = self._encode.encode(stamp_ns(message.header.stamp), decode)
        if encoded.problem:
            self._refused[encoded.problem.cause] += 1
        if encoded.embedding is not None:
            self._outcomes.append(self._query.query(encoded.embedding))
            if self._mapping:
                self._settle(self._mapping.add_embedding(encoded.embedding))

    def _settle(self, updates: Iterable[MapUpdate]) -> None:
        for update in updates:
            if update.problem:
                self._refused[update.problem.cause] += 1
            elif len(update.changed):
                self._query.update(update.changed, self._fingerprint, committed=False)


def _position_topics(bag: Bag, config: Config) -> list[str]:
    """The topic that the map server would listen to, or else the only one of its type."""
    msgtype, name = (FIX_TYPE, FIX) if config.position.source == 'fix' else (ODOMETRY_TYPE, ODOMETRY)
    topics = bag.topics_of(msgtype)
    return [name] if name in topics else topics if len(topics) == 1 else []


def _added_position(mapping: MapStage, msgtype: str, message: Any) -> list[MapUpdate]:
    stamp = stamp_ns(message.header.stamp)
    if msgtype == FIX_TYPE:
        return mapping.add_point(stamp, point_from_fix(message))
    return mapping.add_pose(stamp, pose_from_odometry(message))


def in_lockstep_order(bag: Bag, scan_topic: str, others: Sequence[str], ahead_s: float) -> Iterator[RawMessage]:
    """Messages of a bag, each scan after everything else up to `ahead_s` later than it.

    A scan's position is interpolated, so the one after it has to be known. Live, the map server waits for it; a drive
    that nothing hurries sends it ahead, so that nothing has to wait.
    """
    other = bag.messages(others) if others else iter(())
    waiting = next(other, None)
    for scan in bag.messages([scan_topic]):
        while waiting is not None and waiting.log_ns <= scan.log_ns + round(ahead_s * 1e9):
            yield waiting
            waiting = next(other, None)
        yield scan
    if waiting is not None:
        yield waiting
        yield from other
