"""A bag as a RadarSequence."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.geometry import Trajectory
from offradar_ros.messages import SHORTEST, header_stamp_ns
from offradar_ros.recordings.bags.position_topic import position_topic
from offradar_ros.recordings.bags.positions import arrival_offset_s, arrivals, trajectory_of
from offradar_ros.recordings.bags.reader import Bag, RawMessage
from offradar_ros.recordings.bags.scan_topic import decoded_scan, scan_topic
from offradar_ros.recordings.bags.topics import FIX_TYPE, ChosenTopics
from offradar_ros.types import PolarScan


class BagSequence:
    """Scans of a bag in the order of their stamps, with random access.

    Refused images are not hidden: `scan` raises RefusedInput for them. DataError for a bag without scans, or where it
    does not show which of several topics holds them and `topics` does not say so.
    """

    layout = 'bag'

    def __init__(self, path: str | Path, radar: RadarConfig | None = None, topics: ChosenTopics | None = None) -> None:
        self.path = Path(path)
        self.name = self.path.name
        self._radar = radar or RadarConfig()
        self._trajectory: Trajectory | None = None
        self._no_trajectory: DataError | None = None
        chosen = topics or ChosenTopics()
        with Bag(path) as bag:
            self._paths = bag.paths
            self._topic = scan_topic(bag, self._radar, chosen.scans)
            rows = sorted((_stamp_ns(raw), raw.log_ns, index) for index, raw in enumerate(bag.messages([self._topic])))
            try:
                positions = position_topic(bag, self._topic, chosen.positions)
            except DataError as error:
                if chosen.positions:
                    raise
                # Whoever needs no positions need not choose.
                self._no_trajectory, positions = error, None
            if positions:
                found = list(arrivals(bag, positions))
                trajectory = trajectory_of(found, geodetic=bag.topics[positions] == FIX_TYPE)
                scans = sorted((log_ns, stamp) for stamp, log_ns, _ in rows)
                self._trajectory = dataclasses.replace(trajectory, clock_offset_s=arrival_offset_s(scans, found))
        self._log_ns = [log_ns for _, log_ns, _ in rows]
        self.stamps_ns: NDArray[np.int64] = np.array([stamp for stamp, _, _ in rows], np.int64)

    @property
    def trajectory(self) -> Trajectory | None:
        """Its positions, None if there are none; DataError where several topics may hold them."""
        if self._no_trajectory is not None:
            raise self._no_trajectory
        return self._trajectory

    def __len__(self) -> int:
        return len(self._log_ns)

    def scan(self, index: int) -> PolarScan:
        """Scan `index`, read and decoded at each call."""
        log_ns, stamp = self._log_ns[index], int(self.stamps_ns[index])
        with Bag(self.path, self._paths) as bag:
            found = (raw for raw in bag.messages([self._topic], log_ns, log_ns + 1) if _stamp_ns(raw) == stamp)
            raw = next(found, None)
            if raw is None:
                raise DataError(f'{self.path}: changed while it was read: it no longer holds the scan of {stamp} ns')
            return decoded_scan(bag, raw, self._radar)


def _stamp_ns(raw: RawMessage) -> int:
    """The stamp of a scan; the log time of one that is too short to have one, which `scan` cannot read."""
    return header_stamp_ns(raw.cdr) if len(raw.cdr) >= SHORTEST else raw.log_ns
