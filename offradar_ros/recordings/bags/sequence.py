"""A bag as a RadarSequence."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.geometry import Trajectory
from offradar_ros.messages import header_stamp_ns, scan_from_image
from offradar_ros.recordings.bags.positions import arrival_offset_s, arrivals, position_topics, trajectory_of
from offradar_ros.recordings.bags.reader import Bag, scan_topic
from offradar_ros.recordings.bags.topics import FIX_TYPE
from offradar_ros.types import PolarScan


class BagSequence:
    """Scans of a bag in the order of their stamps, with random access.

    Refused images are not hidden: `scan` raises RefusedInput for them.
    """

    layout = 'bag'

    def __init__(self, path: str | Path, radar: RadarConfig | None = None) -> None:
        self.path = Path(path)
        self.name = self.path.name
        self.trajectory: Trajectory | None = None
        self._radar = radar or RadarConfig()
        with Bag(path) as bag:
            self._topic = scan_topic(bag)
            rows = sorted(
                (header_stamp_ns(raw.cdr), raw.log_ns, index) for index, raw in enumerate(bag.messages([self._topic]))
            )
            topics = position_topics(bag)
            if topics:
                found = list(arrivals(bag, topics[0]))
                trajectory = trajectory_of(found, geodetic=bag.topics[topics[0]] == FIX_TYPE)
                scans = sorted((log_ns, stamp) for stamp, log_ns, _ in rows)
                self.trajectory = dataclasses.replace(trajectory, clock_offset_s=arrival_offset_s(scans, found))
        if not rows:
            raise DataError(f'{self.path}: topic {self._topic} holds no scans')
        self._log_ns = [log_ns for _, log_ns, _ in rows]
        self.stamps_ns: NDArray[np.int64] = np.array([stamp for stamp, _, _ in rows], np.int64)

    def __len__(self) -> int:
        return len(self._log_ns)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, read and decoded at each call."""
        log_ns, stamp = self._log_ns[index], int(self.stamps_ns[index])
        with Bag(self.path) as bag:
            raw = next(
                raw for raw in bag.messages([self._topic], log_ns, log_ns + 1) if header_stamp_ns(raw.cdr) == stamp
            )
            return scan_from_image(bag.decode(raw), self._radar)
