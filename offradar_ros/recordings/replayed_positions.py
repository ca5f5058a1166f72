"""How many scans of a recording would get a position from the nodes, without an encoder."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterable

import numpy as np

from offradar_ros.config import PositionConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.pending import Resolved
from offradar_ros.radar.stamps import StampGate
from offradar_ros.stages.positioning import Positioning
from offradar_ros.types import Embedding, Pose

_NOTHING = np.empty(0, np.float32)
_HERE = Pose(0.0, 0.0)


def count_positioned(
    scans: Iterable[tuple[int, int]],
    positions: Iterable[tuple[int, int]],
    config: PositionConfig,
    restart_after_s: float,
) -> int:
    """How many scans get a position in the order in which `drive` reads; all are given by log time and stamp in ns.

    The same objects decide as on the vehicle: a scan waits for `position.wait_s`, by the stamps of the others, and
    their stamps may go back by more than the radar's `restart_after_s`.
    """
    # No heading is asked for, and none changes what gets a position.
    config = dataclasses.replace(config, heading='none')
    positioning: Positioning[Pose] = Positioning(config, lambda stamp_ns, pose: [(stamp_ns, pose)])
    gate = StampGate(round(restart_after_s * 1e9))
    resolved: list[Resolved] = []
    waiting = iter(positions)
    following = next(waiting, None)

    def add_position(stamp_ns: int) -> None:
        with contextlib.suppress(RefusedInput):
            resolved.extend(positioning.add_position(stamp_ns, _HERE))

    for log_ns, stamp_ns in scans:
        while following is not None and following[0] <= log_ns + round(config.max_gap_s * 1e9):
            add_position(following[1])
            following = next(waiting, None)
        try:
            gate.check(stamp_ns)
        except RefusedInput:
            continue
        resolved += positioning.add_scan(Embedding(stamp_ns, _NOTHING, _NOTHING))
    while following is not None:
        add_position(following[1])
        following = next(waiting, None)
    resolved += positioning.flush()
    return sum(item.pose is not None for item in resolved)
