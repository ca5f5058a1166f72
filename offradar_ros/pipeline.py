"""The way of a scan, stage by stage: encode, map, query.

The live nodes, the replay and the command line all drive these stages and nothing else, so that they give the same
answer on the same recording.
"""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from offradar_ros.bags.reader import Bag, RawMessage, scan_topic
from offradar_ros.bags.records import point_from_fix, pose_from_odometry, scan_from_image, stamp_ns
from offradar_ros.bags.topics import FIX_TYPE, ODOMETRY_TYPE
from offradar_ros.config import Config
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.geometry import GeoPoint, LocalFrame
from offradar_ros.mapping.pending import PendingEmbeddings, Settled
from offradar_ros.mapping.session_report import SessionReport
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.radar.stamps import StampGate
from offradar_ros.retrieval.introspective_query import IntrospectiveQuery
from offradar_ros.types import Embedding, Outcome, PlaceTable, PolarScan, Pose

OUT_OF_ORDER = ('repeated_stamp', 'stamp_backwards')


@dataclasses.dataclass(frozen=True)
class Encoded:
    """What became of one image.

    Attributes:
        embedding: None only for a scan out of order, whose stamp may have been answered already; invalid (d = 0) for
            one that cannot be encoded, so that every scan in order gets exactly one answer.
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
            if problem.cause in OUT_OF_ORDER:
                return Encoded(None, problem)
            return Encoded(self._invalid(stamp), problem, restarted)

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
        self._last_scan_ns = 0

    def add_point(self, stamp: int, point: GeoPoint) -> list[MapUpdate]:
        """A geodetic position; the first one ever is the origin of the map's frame."""
        if self._frame is None:
            self.map.set_origin(point)
            self._frame = LocalFrame(point)
        enu = self._frame.to_enu(np.array([[point.latitude_deg, point.longitude_deg, point.altitude_m]]))[0]
        return self.add_pose(stamp, Pose(float(enu[0]), float(enu[1]), float(enu[2])))

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
        # The recording starts again: nothing that still waits will get its position.
        updates = self.flush() if embedding.stamp_ns < self._last_scan_ns else []
        self._last_scan_ns = embedding.stamp_ns
        return updates + self._merged(self._pending.add_embedding(embedding))

    def flush(self) -> list[MapUpdate]:
        """Settle what still waits: no later position will come for it."""
        return self._merged(self._pending.flush())

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
    encode, query = EncodeStage(encoder, config.radar.restart_after_s), IntrospectiveQuery(config.query)
    mapping: MapStage | None = None
    if isinstance(session_map, SessionMap):
        session_map.adopt_model(encoder.info)
        query.load(session_map.committed(), encoder.info.fingerprint)
        if session is not None:
            mapping = MapStage(config, session_map)
            session_map.start_session(session, bag.start_ns)
    else:
        query.load(session_map, encoder.info.fingerprint)
    outcomes: list[Outcome] = []
    refused: Counter[str] = Counter()

    def settle(updates: Iterable[MapUpdate]) -> None:
        for update in updates:
            if update.problem:
                refused[update.problem.cause] += 1
            elif len(update.changed):
                query.update(update.changed, encoder.info.fingerprint, committed=False)

    topic = scan_topic(bag)
    total = bag.counts[topic]
    position_type = FIX_TYPE if config.position.source == 'fix' else ODOMETRY_TYPE
    position_topics = bag.topics_of(position_type)[:1] if mapping else []
    for raw in in_lockstep_order(bag, topic, position_topics, config.position.max_gap_s):
        message = bag.decode(raw)
        stamp = stamp_ns(message.header.stamp)
        try:
            if raw.topic == topic:
                encoded = encode.encode(stamp, functools.partial(scan_from_image, message, config.radar))
                if encoded.problem:
                    refused[encoded.problem.cause] += 1
                if encoded.embedding is not None:
                    outcomes.append(query.query(encoded.embedding))
                    if mapping:
                        settle(mapping.add_embedding(encoded.embedding))
                if progress:
                    progress(len(outcomes), total)
            elif mapping and raw.msgtype == FIX_TYPE:
                settle(mapping.add_point(stamp, point_from_fix(message)))
            elif mapping:
                settle(mapping.add_pose(stamp, pose_from_odometry(message)))
        except RefusedInput as problem:
            refused[problem.cause] += 1
    report = None
    if mapping:
        updates, report = mapping.end_session()
        settle(updates)
    return DriveResult(tuple(outcomes), report, refused)


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
