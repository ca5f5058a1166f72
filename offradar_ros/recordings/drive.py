"""A recording through the stages, as the nodes do on the vehicle."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from offradar_ros.config import Config
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.session_report import SessionReport
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.messages import point_from_fix, pose_from_odometry, stamp_ns
from offradar_ros.positions.clocks import ArrivalClocks, clock_problem
from offradar_ros.positions.track import PositionTrack
from offradar_ros.recordings.bags.position_topic import position_topic
from offradar_ros.recordings.bags.reader import Bag, RawMessage
from offradar_ros.recordings.bags.scan_topic import DECODERS, scan_topic
from offradar_ros.recordings.bags.topics import FIX_TYPE, ODOMETRY_TYPE, VEHICLE_ODOMETRY, ChosenTopics
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.datasets.check.repeats import Repeats
from offradar_ros.retrieval.signature_source import SignatureSource
from offradar_ros.stages.encode import EncodeStage
from offradar_ros.stages.map import MapStage, MapUpdate
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Localisation, Outcome, PlaceTable, PolarScan, Pose

POSITION_TYPES = {'fix': FIX_TYPE, 'odometry': ODOMETRY_TYPE}
"""Message type of the positions, by position.source."""


@dataclasses.dataclass(frozen=True)
class DriveResult:
    """Result of a drive through the stages.

    Attributes:
        outcomes: one for each embedding, in order.
        localisations: where the vehicle is after each embedding; None where that is not known.
        report: of the session that the drive was mapped as; None if it was not mapped.
        refused: dropped scans and positions by cause.
        warnings: what keeps positions out of the map, or spoils them, scans that are repeated or go without a
            signature, one line each.
    """

    outcomes: tuple[Outcome, ...]
    localisations: tuple[Localisation | None, ...]
    report: SessionReport | None
    refused: Counter[str]
    warnings: tuple[str, ...] = ()


def drive(
    bag: Bag,
    config: Config,
    encoder: Encoder,
    session_map: SessionMap | PlaceTable,
    *,
    session: str | None = None,
    topics: ChosenTopics | None = None,
    signatures: SignatureSource | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DriveResult:
    """Encode, map (if `session` names one) and query every scan of a bag, as the nodes do on the vehicle.

    DataError, before anything is mapped, for a bag without scans, or where it does not show which of several topics is
    meant and `topics` does not say so. Where `topics` chooses the positions, their type decides, not position.source.

    Queries search the map as of the last ended session; without query.exclude_current_session, the running one too.
    A drive that maps nothing may search a table of places instead, made with the encoder's model, with `signatures` of
    their scans.
    """
    chosen = topics or ChosenTopics()
    scans = scan_topic(bag, config.radar, chosen.scans)
    positions = None
    try:
        positions = position_topic(bag, scans, chosen.positions, POSITION_TYPES[config.position.source])
    except DataError:
        # Who maps nothing needs none; they only tell whether the clocks agree.
        if session is not None:
            raise
    if isinstance(session_map, SessionMap):
        signatures = session_map.signatures
    whole = _Drive(bag, config, encoder, session_map, session, scans, positions, signatures)
    return whole.run(progress or (lambda _done, _total: None))


class _Drive:
    """The three stages on one recording."""

    def __init__(
        self,
        bag: Bag,
        config: Config,
        encoder: Encoder,
        session_map: SessionMap | PlaceTable,
        session: str | None,
        scans: str,
        positions: str | None,
        signatures: SignatureSource | None,
    ) -> None:
        self._bag, self._config = bag, config
        self._scans, self._positions = scans, positions
        self._fingerprint = encoder.info.fingerprint
        self._encode = EncodeStage(encoder, config.radar.restart_after_s, signature=config.encoder.signature)
        self._no_signature = Counter[str]()
        self._query = QueryStage(config.query, config.localisation, signatures)
        self._mapping: MapStage | None = None
        self._outcomes: list[Outcome] = []
        self._localisations: list[Localisation | None] = []
        self._refused: Counter[str] = Counter()
        self._clocks = ArrivalClocks()
        self._motion = ScanClock()
        self._repeats = Repeats()
        self._track = PositionTrack(geodetic=positions is not None and bag.topics[positions] == FIX_TYPE)
        if isinstance(session_map, PlaceTable):
            self._query.load(session_map, self._fingerprint)
            return
        session_map.adopt_model(encoder.info)
        self._query.load(session_map.committed(), self._fingerprint)
        if session is not None:
            self._mapping = MapStage(config, session_map)
            session_map.start_session(session, bag.start_ns)

    def run(self, progress: Callable[[int, int], None]) -> DriveResult:
        scans = self._scans
        total = self._bag.counts[scans]
        positions = [self._positions] if self._positions else []
        odometry = [topic for topic in self._bag.topics_of(ODOMETRY_TYPE) if topic == VEHICLE_ODOMETRY]
        others = sorted({*positions, *odometry})
        for raw in in_lockstep_order(self._bag, scans, others, self._config.position.max_gap_s):
            message = self._bag.decode(raw)
            try:
                if raw.topic == scans:
                    self._handle_scan(raw, message)
                    progress(len(self._outcomes), total)
                    continue
                if raw.topic in odometry:
                    self._query.add_odometry(stamp_ns(message.header.stamp), pose_from_odometry(message))
                if raw.topic in positions:
                    self._handle_position(raw, message)
            except RefusedInput as problem:
                self._refused[problem.cause] += 1
        report = None
        warnings = [*(finding.text for finding in self._repeats.findings()), self._clock_problem()]
        if self._mapping:
            updates, report = self._mapping.end_session()
            self._apply(updates)
            warnings += [self._mapping.problem(), self._mapping.heading_problem()]
        if self._no_signature:
            ((commonest, _),) = self._no_signature.most_common(1)
            warnings.append(f'no signature could be made of {self._no_signature.total()} scans: {commonest}')
        told = tuple(warning for warning in warnings if warning)
        return DriveResult(tuple(self._outcomes), tuple(self._localisations), report, self._refused, told)

    def _handle_scan(self, raw: RawMessage, message: Any) -> None:
        stamp = stamp_ns(message.header.stamp)
        self._clocks.add_scan(raw.log_ns, stamp)
        encoded = self._encode.encode(stamp, functools.partial(self._decoded, raw.msgtype, message))
        if encoded.problem:
            self._refused[encoded.problem.cause] += 1
        if encoded.no_signature:
            self._no_signature[encoded.no_signature] += 1
        if encoded.embedding is not None:
            self._outcomes.append(self._query.query(encoded.embedding))
            self._localisations.append(self._localised())
            if self._mapping:
                self._apply(self._mapping.add_embedding(encoded.embedding))

    def _decoded(self, msgtype: str, message: Any) -> PolarScan:
        scan: PolarScan = DECODERS[msgtype](message, self._config.radar)
        self._motion.add(scan)
        self._repeats.add(scan, f'at {scan.stamp_ns} ns')
        return scan

    def _handle_position(self, raw: RawMessage, message: Any) -> None:
        try:
            stamp = stamp_ns(message.header.stamp)
            position = point_from_fix(message) if raw.msgtype == FIX_TYPE else pose_from_odometry(message)
        except RefusedInput:
            if self._mapping:
                raise
            return
        self._clocks.add_position(raw.log_ns, stamp)
        with contextlib.suppress(RefusedInput):
            if isinstance(position, Pose):
                self._track.add_pose(stamp, position)
            else:
                self._track.add_point(stamp, dataclasses.astuple(position))
        if self._mapping and isinstance(position, Pose):
            self._apply(self._mapping.add_pose(stamp, position))
        elif self._mapping and isinstance(position, GeoPoint):
            self._apply(self._mapping.add_point(stamp, position))

    def _clock_problem(self) -> str:
        by_arrival = clock_problem(self._clocks.offset_s())
        return by_arrival or self._motion.problem(self._track.trajectory(), self._config.position.max_gap_s)

    def _localised(self) -> Localisation | None:
        try:
            return self._query.localise()
        except RefusedInput as problem:
            self._refused[problem.cause] += 1
            return None

    def _apply(self, updates: Iterable[MapUpdate]) -> None:
        if self._mapping:
            for left_out in self._mapping.take_left_out():
                self._refused[left_out.cause] += left_out.count
            if self._mapping.take_discarded():
                self._query.load(self._mapping.map.committed(), self._fingerprint)
        for update in updates:
            if update.problem:
                self._refused[update.problem.cause] += 1
            elif len(update.changed):
                self._query.update(update.changed, self._fingerprint, committed=False)


def in_lockstep_order(bag: Bag, scan_topic: str, others: Sequence[str], ahead_s: float) -> Iterator[RawMessage]:
    """Messages of a bag, each scan after all messages of `others` up to `ahead_s` later than it.

    A scan's position is interpolated, so the position after it must be known. On a vehicle the map server waits for
    that one; a recording has it already, so it comes before the scan, which may still wait for its heading.
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
