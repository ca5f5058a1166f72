"""rosbag2 folders (MCAP or SQLite storage) as raw messages, and as a RadarSequence."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from offradar_ros.bags.records import point_from_fix, pose_from_odometry, scan_from_image, stamp_ns
from offradar_ros.bags.topics import FIX_TYPE, IMAGE_TYPE, ODOMETRY_TYPE
from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.geometry import Trajectory
from offradar_ros.types import PolarScan

TYPES = get_typestore(Stores.ROS2_JAZZY)


@dataclasses.dataclass(frozen=True, slots=True)
class RawMessage:
    """One recorded message: its topic, type, log time and CDR bytes."""

    topic: str
    msgtype: str
    log_ns: int
    cdr: bytes


def is_bag(path: str | Path) -> bool:
    """Whether `path` is a rosbag2 folder or an unfinished or foreign one that only a bag reader can judge."""
    path = Path(path)
    return (path / 'metadata.yaml').exists() or path.suffix == '.mcap' or any(path.glob('*.mcap'))


class Bag:
    """An open rosbag2 folder; every failure of reading is a DataError that names it."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise DataError(f'{self.path}: no such bag')
        if self.path.is_dir() and not (self.path / 'metadata.yaml').exists():
            raise DataError(f'{self.path}: no metadata.yaml: not a rosbag2 folder, or a recording that was cut off')
        with self._named_errors():
            self._reader = Reader(self.path)
            self._reader.open()

    @contextlib.contextmanager
    def _named_errors(self) -> Iterator[None]:
        # Damage shows as any error of the container, its compression or its decoding.
        try:
            yield
        except (DataError, RefusedInput):
            raise
        except Exception as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise DataError(f'{self.path}: not a readable rosbag2 recording ({reason})') from error

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._reader.close()

    @property
    def topics(self) -> dict[str, str]:
        """Topic names and their message types."""
        return {connection.topic: connection.msgtype for connection in self._reader.connections}

    @property
    def counts(self) -> dict[str, int]:
        """Topic names and how many messages each has."""
        return {topic: info.msgcount for topic, info in self._reader.topics.items()}

    @property
    def start_ns(self) -> int:
        """Log time of the first message."""
        return int(self._reader.start_time)

    @property
    def end_ns(self) -> int:
        """Log time just after the last message."""
        return int(self._reader.end_time)

    def topics_of(self, msgtype: str) -> list[str]:
        """Topics of one message type."""
        return [topic for topic, found in self.topics.items() if found == msgtype]

    def messages(
        self, topics: Sequence[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Messages in order of log time, of all topics or of some."""
        connections = [c for c in self._reader.connections if topics is None or c.topic in topics]
        if not connections:
            return
        with self._named_errors():
            for connection, log_ns, raw in self._reader.messages(connections, start=start_ns, stop=stop_ns):
                yield RawMessage(connection.topic, connection.msgtype, log_ns, bytes(raw))

    def decode(self, message: RawMessage) -> Any:
        """The message as an object with its fields as attributes."""
        with self._named_errors():
            return TYPES.deserialize_cdr(message.cdr, message.msgtype)


def scan_topic(bag: Bag) -> str:
    """The one topic of polar images; DataError if there is none or it is not the only one."""
    topics = bag.topics_of(IMAGE_TYPE)
    if len(topics) == 1:
        return topics[0]
    wanted = [topic for topic in topics if topic.endswith(('b_scan_image', 'radar/polar', 'Navtech/Polar'))]
    if len(wanted) == 1:
        return wanted[0]
    held = ', '.join(topics) or 'none'
    raise DataError(f'{bag.path}: expected one topic of {IMAGE_TYPE} with polar scans, found {held}')


class BagSequence:
    """A bag as a RadarSequence, with random access by log time.

    Scans keep their header stamps. Refused images are not hidden: `scan` raises RefusedInput for them.
    """

    layout = 'bag'

    def __init__(self, path: str | Path, radar: RadarConfig | None = None) -> None:
        self.path = Path(path)
        self.name = self.path.name
        self._radar = radar or RadarConfig()
        with Bag(path) as bag:
            self._topic = scan_topic(bag)
            rows = [(m.log_ns, _header_stamp_ns(m.cdr)) for m in bag.messages([self._topic])]
            self.trajectory = read_trajectory(bag)
        if not rows:
            raise DataError(f'{self.path}: topic {self._topic} holds no scans')
        self._log_ns = [log for log, _ in rows]
        self.stamps_ns: NDArray[np.int64] = np.array([stamp for _, stamp in rows], np.int64)

    def __len__(self) -> int:
        return len(self._log_ns)

    def scan(self, index: int) -> PolarScan:
        """Scan `index` in order of log time."""
        log_ns = self._log_ns[index]
        same_time_before = self._log_ns[:index].count(log_ns)
        with Bag(self.path) as bag:
            found = list(bag.messages([self._topic], log_ns, log_ns + 1))
            return scan_from_image(bag.decode(found[same_time_before]), self._radar)


def _header_stamp_ns(cdr: bytes) -> int:
    # Every message with a leading std_msgs/Header starts, after the 4 bytes of encapsulation, with sec and nanosec.
    seconds, nanoseconds = np.frombuffer(cdr, '<i4', 1, 4)[0], np.frombuffer(cdr, '<u4', 1, 8)[0]
    return int(seconds) * 10**9 + int(nanoseconds)


def read_trajectory(bag: Bag) -> Trajectory | None:
    """Positions of a bag: fixes where it has them, else odometry; invalid and repeated ones are left out."""
    for msgtype in (FIX_TYPE, ODOMETRY_TYPE):
        topics = bag.topics_of(msgtype)
        if topics:
            return _trajectory(bag, topics[0], geodetic=msgtype == FIX_TYPE)
    return None


def _trajectory(bag: Bag, topic: str, *, geodetic: bool) -> Trajectory:
    rows: list[tuple[int, float, float, float, float]] = []
    for raw in bag.messages([topic]):
        message = bag.decode(raw)
        stamp = stamp_ns(message.header.stamp)
        if rows and stamp <= rows[-1][0]:
            continue
        with contextlib.suppress(RefusedInput):
            if geodetic:
                point = point_from_fix(message)
                rows.append((stamp, point.latitude_deg, point.longitude_deg, point.altitude_m, np.nan))
            else:
                pose = pose_from_odometry(message)
                rows.append((stamp, pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad))
    return Trajectory(
        stamps_ns=np.array([row[0] for row in rows], np.int64),
        positions=np.array([row[1:4] for row in rows], np.float64).reshape(-1, 3),
        yaws_rad=np.array([row[4] for row in rows], np.float64),
        geodetic=geodetic,
    )
