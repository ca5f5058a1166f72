"""rosbag2 recordings (folders, or single MCAP or SQLite files) as raw messages."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.interfaces import Connection, QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.recordings.bags.bag_check import check_bag_files, read_in_order, require_all_read
from offradar_ros.recordings.bags.bag_facts import joined
from offradar_ros.recordings.bags.storage import readable_paths, unreadable

TYPES = get_typestore(Stores.ROS2_JAZZY)
_ZSTD = b'\x28\xb5\x2f\xfd'


@dataclasses.dataclass(frozen=True, slots=True)
class RawMessage:
    """One recorded message: its topic, type, log time and CDR bytes."""

    topic: str
    msgtype: str
    log_ns: int
    cdr: bytes


class Bag:
    """An open rosbag2 recording; every failure of reading is a DataError that names it.

    A topic that was recorded with two message types counts as one of that type which has more messages; `left_out` says
    how many messages of the other there are.
    """

    def __init__(self, path: str | Path, paths: tuple[Path, ...] | None = None) -> None:
        """Open the recording `path`; `paths` are those of an earlier `Bag` of it, whose files need no second look."""
        self.path = Path(path)
        self.paths = readable_paths(self.path) if paths is None else paths
        self.topics: dict[str, str] = {}
        """Topic names and their message types."""
        self._readers: list[Reader] = []
        self._open = contextlib.ExitStack()
        with self._named_errors():
            facts = {each: check_bag_files(each) for each in self.paths}
            self._facts = joined(facts.values())
            self.paths = tuple(sorted(self.paths, key=lambda each: facts[each].start_ns))
            try:
                for each in self.paths:
                    reader = Reader(each)
                    reader.open()
                    self._open.callback(reader.close)
                    require_all_read(self.path, reader)
                    read_in_order(each, reader)
                    self._readers.append(reader)
                self._counts = Counter[tuple[str, str]]()
                for connection in self._connections():
                    held = connection.topic, connection.msgtype
                    # Not what a table of the file says, which no checksum need cover.
                    self._counts[held] = self._facts.counts[held]
                for (topic, msgtype), count in self._counts.items():
                    if count > self._counts.get((topic, self.topics.get(topic, '')), -1):
                        self.topics[topic] = msgtype
            except BaseException:
                self._open.close()
                raise

    @contextlib.contextmanager
    def _named_errors(self) -> Iterator[None]:
        # Damage shows as any error of the container, its compression or its decoding.
        try:
            yield
        except (DataError, RefusedInput):
            raise
        except Exception as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise unreadable(self.path, re.sub('[;,.]? please report.*', '', reason)) from error

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def _connections(self) -> Iterator[Connection]:
        for reader in self._readers:
            yield from reader.connections

    @property
    def counts(self) -> dict[str, int]:
        """Topic names and how many messages each has."""
        return {topic: self._counts[topic, msgtype] for topic, msgtype in sorted(self.topics.items())}

    @property
    def left_out(self) -> dict[tuple[str, str], int]:
        """Messages of a second type on a topic, by topic and type: they are not read."""
        return {(topic, kind): count for (topic, kind), count in self._counts.items() if self.topics[topic] != kind}

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

    def is_latched(self, topic: str) -> bool:
        """Whether the topic was recorded from a publisher that keeps its last message for late subscribers."""
        return any(
            profile.durability == QosDurability.TRANSIENT_LOCAL
            for connection in self._connections()
            if connection.topic == topic
            for profile in getattr(connection.ext, 'offered_qos_profiles', ())
        )

    def messages(
        self, topics: Sequence[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Messages in order of log time, of all topics or of some."""
        read = {topic: kind for topic, kind in self.topics.items() if topics is None or topic in topics}
        for reader in self._readers:
            connections = [c for c in reader.connections if read.get(c.topic) == c.msgtype]
            if not connections:
                continue
            with self._named_errors():
                for connection, log_ns, raw in reader.messages(connections, start=start_ns, stop=stop_ns):
                    cdr = bytes(raw)
                    if cdr.startswith(_ZSTD):
                        raise unreadable(
                            self.path, 'its messages are compressed one by one: give the folder with its metadata.yaml'
                        )
                    yield RawMessage(connection.topic, connection.msgtype, log_ns, cdr)

    def decode(self, message: RawMessage) -> Any:
        """The message as an object with its fields as attributes."""
        with self._named_errors():
            return decode_message(message.cdr, message.msgtype)


def decode_message(cdr: bytes, msgtype: str) -> Any:
    """The message in CDR bytes. Bytes after it are ignored: some drivers send a buffer that is not full."""
    definition = TYPES.get_msgdef(msgtype)
    read = definition.deserialize_cdr_le if cdr[1] else definition.deserialize_cdr_be
    return read(cdr[4:], 0, definition.cls, TYPES)[0]
