"""How many scans of a recording would get a position from the nodes, without an encoder."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from offradar_ros.config import PositionConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.pending import Resolved
from offradar_ros.radar.stamps import StampGate
from offradar_ros.recordings.bags.positions import Arrival
from offradar_ros.stages.positioning import Positioning
from offradar_ros.types import Embedding, Pose

_NOTHING = np.empty(0, np.float32)
_HERE = Pose(0.0, 0.0)
_RESTART_AFTER_NS = 10**9


def count_positioned(scans: Sequence[tuple[int, int]], positions: Iterable[Arrival], config: PositionConfig) -> int:
    """How many of the scans, given by log time and stamp in ns, get a position in the order in which `drive` reads.

    The same objects decide as on the vehicle: a scan waits for `position.wait_s`, by the stamps of the others.
    """
    positioning: Positioning[Pose] = Positioning(config, lambda stamp_ns, pose: [(stamp_ns, pose)])
    gate = StampGate(_RESTART_AFTER_NS)
    resolved: list[Resolved] = []
    waiting = iter(positions)
    following = next(waiting, None)

    def add_position(arrival: Arrival) -> None:
        if isinstance(arrival.position, RefusedInput):
            return
        try:
            resolved.extend(positioning.add_position(arrival.stamp_ns, _HERE))
        except RefusedInput:
            return

    for log_ns, stamp_ns in scans:
        while following is not None and following.log_ns <= log_ns + round(config.max_gap_s * 1e9):
            add_position(following)
            following = next(waiting, None)
        try:
            gate.check(stamp_ns)
        except RefusedInput:
            continue
        resolved += positioning.add_scan(Embedding(stamp_ns, _NOTHING, _NOTHING))
    while following is not None:
        add_position(following)
        following = next(waiting, None)
    resolved += positioning.flush()
    return sum(item.pose is not None for item in resolved)
