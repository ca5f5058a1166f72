"""Check of a bag: what it holds, and every problem that is found."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.messages import stamp_ns
from offradar_ros.positions.clocks import clock_problem
from offradar_ros.recordings.bags.position_topic import position_topic
from offradar_ros.recordings.bags.positions import arrival_offset_s, arrivals, position_topics, trajectory_of
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.scan_topic import DECODERS, scan_topic
from offradar_ros.recordings.bags.storage import METADATA, unlisted_files
from offradar_ros.recordings.bags.topics import FIX_TYPE, ChosenTopics
from offradar_ros.recordings.datasets.check.clocks import ScanClock
from offradar_ros.recordings.datasets.check.coverage import coverage
from offradar_ros.recordings.datasets.check.findings import Finding, Findings, counted, first_few, note, ok, problem
from offradar_ros.recordings.datasets.check.scan_faults import ScanFaults
from offradar_ros.recordings.datasets.check.stamps import check_stamps
from offradar_ros.recordings.left_out import left_out_text
from offradar_ros.recordings.replayed_positions import count_positioned


class _Scans(NamedTuple):
    """When the scans were recorded and their headers' stamps, in that order, and how the radar moved."""

    logs_ns: list[int]
    stamps_ns: list[int]
    clock: ScanClock


def check_bag(
    path: str | Path,
    radar: RadarConfig | None = None,
    position: PositionConfig | None = None,
    topics: ChosenTopics | None = None,
) -> Findings:
    """Read every message of a bag; DataError where it cannot be read at all."""
    with Bag(path) as bag:
        found = (
            *_unlisted(Path(path)),
            *_findings(bag, radar or RadarConfig(), position or PositionConfig(), topics or ChosenTopics()),
        )
    return Findings(Path(path), 'bag', found)


def _unlisted(path: Path) -> Iterator[Finding]:
    names = unlisted_files(path)
    if names:
        yield problem(
            f'{first_few(names)}: in the folder, but not in {METADATA}, so not read: ros2 bag reindex adds it, or move '
            'it elsewhere'
        )


def _findings(bag: Bag, radar: RadarConfig, position: PositionConfig, chosen: ChosenTopics) -> Iterator[Finding]:
    for topic, count in bag.counts.items():
        yield ok(f'topic {topic}: {counted(count, "message")} of {bag.topics[topic]}')
    for (topic, msgtype), count in bag.left_out.items():
        yield problem(f'topic {topic}: {counted(count, "message")} of a second type, {msgtype}: not read')
    try:
        topic = scan_topic(bag, radar, chosen.scans)
    except DataError as error:
        yield problem(str(error))
        return
    yield ok(f'scans: {topic}')
    scans = _Scans([], [], ScanClock())
    faults = ScanFaults()
    refused: dict[str, list[str]] = {}
    for raw in bag.messages([topic]):
        message = bag.decode(raw)
        try:
            stamp = stamp_ns(message.header.stamp)
            scans.stamps_ns.append(stamp)
            scans.logs_ns.append(raw.log_ns)
            scan = DECODERS[raw.msgtype](message, radar)
        except RefusedInput as refusal:
            refused.setdefault(refusal.cause, []).append(str(refusal))
        else:
            faults.add(scan, f'at {scan.stamp_ns} ns')
            scans.clock.add(scan)
    yield from faults.findings()
    for cause, messages in sorted(refused.items()):
        yield problem(f'{counted(len(messages), "scan")} would be refused ({cause}): {messages[0]}')
    yield from check_stamps(np.array(scans.stamps_ns, np.int64))
    topics = position_topics(bag)
    try:
        positions = position_topic(bag, topic, chosen.positions)
    except DataError as error:
        yield problem(str(error))
    else:
        if positions is not None:
            yield ok(f'positions: {positions}')
            topics = [positions] if chosen.positions else topics
    yield from _positions(bag, topics, scans, radar, position)


def _positions(
    bag: Bag, topics: list[str], scans: _Scans, radar: RadarConfig, position: PositionConfig
) -> Iterator[Finding]:
    if not topics:
        yield note('no positions: this bag can be queried with, not mapped')
    for topic in topics:
        found = list(arrivals(bag, topic))
        trajectory = trajectory_of(found, geodetic=bag.topics[topic] == FIX_TYPE)
        for left_out in trajectory.left_out:
            yield problem(left_out_text(topic, left_out))
        if not scans.stamps_ns:
            continue
        used = set(trajectory.stamps_ns.tolist())
        usable = [(log_ns, stamp) for log_ns, stamp, _ in found if stamp in used]
        arrived = zip(scans.logs_ns, scans.stamps_ns, strict=True)
        in_time = count_positioned(arrived, usable, position, radar.restart_after_s)
        yield coverage(topic, np.array(scans.stamps_ns, np.int64), trajectory, position, in_time=in_time)
        by_arrival = clock_problem(arrival_offset_s(zip(scans.logs_ns, scans.stamps_ns, strict=True), found))
        if by_arrival:
            yield problem(f'{topic}: {by_arrival}')
        else:
            yield from scans.clock.findings(topic, trajectory, position.max_gap_s)
