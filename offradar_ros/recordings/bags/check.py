"""Check of a bag: what it holds, and every problem that is found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.messages import stamp_ns
from offradar_ros.recordings.bags.position_topic import position_topic
from offradar_ros.recordings.bags.positions import position_topics, read_positions
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.scan_topic import DECODERS, scan_topic
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.datasets.check.coverage import coverage
from offradar_ros.recordings.datasets.check.findings import Finding, Findings, counted, note, ok, problem
from offradar_ros.recordings.datasets.check.scans import ROW_FAULTS
from offradar_ros.recordings.datasets.check.sizes import Sizes
from offradar_ros.recordings.datasets.check.stamps import check_stamps
from offradar_ros.recordings.row_tally import MENDED


def check_bag(
    path: str | Path,
    radar: RadarConfig | None = None,
    position: PositionConfig | None = None,
    topics: ChosenTopics | None = None,
) -> Findings:
    """Read every message of a bag; DataError where it cannot be read at all."""
    with Bag(path) as bag:
        max_gap_s = (position or PositionConfig()).max_gap_s
        found = tuple(_findings(bag, radar or RadarConfig(), max_gap_s, topics or ChosenTopics()))
    return Findings(Path(path), 'bag', found)


def _findings(bag: Bag, radar: RadarConfig, max_gap_s: float, chosen: ChosenTopics) -> Iterator[Finding]:
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
    stamps: list[int] = []
    sizes = Sizes()
    refused: dict[str, list[str]] = {}
    mended: Counter[str] = Counter()
    for raw in bag.messages([topic]):
        message = bag.decode(raw)
        stamps.append(stamp_ns(message.header.stamp))
        try:
            scan = DECODERS[raw.msgtype](message, radar)
        except RefusedInput as refusal:
            refused.setdefault(refusal.cause, []).append(str(refusal))
        else:
            sizes.add(scan, f'at {scan.stamp_ns} ns')
            mended.update(fault for fault in scan.row_faults if fault in MENDED)
    yield from sizes.findings()
    for cause, messages in sorted(refused.items()):
        yield problem(f'{counted(len(messages), "scan")} would be refused ({cause}): {messages[0]}')
    for fault, count in mended.items():
        yield problem(f'{ROW_FAULTS[fault]}: {counted(count, "scan")}')
    stamps_ns = np.array(stamps, np.int64)
    yield from check_stamps(stamps_ns)
    topics = position_topics(bag)
    try:
        positions = position_topic(bag, topic, chosen.positions)
    except DataError as error:
        yield problem(str(error))
    else:
        if positions is not None:
            yield ok(f'positions: {positions}')
            topics = [positions] if chosen.positions else topics
    yield from _positions(bag, topics, stamps_ns, max_gap_s)


def _positions(bag: Bag, topics: list[str], stamps_ns: NDArray[np.int64], max_gap_s: float) -> Iterator[Finding]:
    if not topics:
        yield note('no positions: this bag can be queried with, not mapped')
    for topic in topics:
        trajectory, refused = read_positions(bag, topic)
        for cause, count in sorted(refused.items()):
            yield problem(f'{topic}: {counted(count, "position")} would be refused ({cause})')
        if len(stamps_ns):
            yield coverage(topic, stamps_ns, trajectory, max_gap_s)
