"""rosbag2 folders (MCAP or SQLite storage) as raw messages."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.recordings.bags.bag_check import check_bag_files, require_all_read
from offradar_ros.recordings.bags.topics import IMAGE_TYPE

TYPES = get_typestore(Stores.ROS2_JAZZY)


@dataclasses.dataclass(frozen=True, slots=True)
class RawMessage:
    """One recorded message: its topic, type, log time and CDR bytes."""

    topic: str
    msgtype: str
    log_ns: int
    cdr: bytes


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
            self._facts = check_bag_files(self.path)
            self._reader.open()
            require_all_read(self.path, self._reader)

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
        return self._facts.start_ns

    @property
    def end_ns(self) -> int:
        """Log time just after the last message."""
        return self._facts.end_ns

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
            return decode_message(message.cdr, message.msgtype)


def decode_message(cdr: bytes, msgtype: str) -> Any:
    """The message in CDR bytes. Bytes after it are ignored: some drivers send a buffer that is not full."""
    definition = TYPES.get_msgdef(msgtype)
    read = definition.deserialize_cdr_le if cdr[1] else definition.deserialize_cdr_be
    return read(cdr[4:], 0, definition.cls, TYPES)[0]


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
