"""Reads an MCAP file once from end to end: its checksums hold, and its tables name every message that is in it.

A reader goes by the tables of the summary. Where they are damaged, it leaves messages out without a word.
"""

from __future__ import annotations

import dataclasses
import struct
from collections import Counter
from pathlib import Path
from typing import BinaryIO

from offradar_ros.recordings.bags.bag_facts import BagFacts
from offradar_ros.recordings.bags.inflate import inflate_message
from offradar_ros.recordings.bags.mcap_checksums import CHECKSUM_IN_FOOTER
from offradar_ros.recordings.bags.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    MESSAGE,
    SCHEMA,
    Chunk,
    Damage,
    Fields,
    Record,
    body_of,
    checksum_of,
    inner_records,
    open_chunk,
    top_records,
)

MAX_CHANNELS = 4096
MAX_DESCRIPTIONS_BYTES = 64 * 1024**2
"""Most bytes of all schemas and channels together."""
_MESSAGE_HEAD = 22
_INDEX_BYTES = 31
"""Fewest bytes of the index of a channel that has a message."""


def check_mcap(path: Path, compressed_messages: bool = False) -> BagFacts:
    """The facts of a file; Damage, or CutOff, if it is not whole, or not as its checksums and tables say.

    `compressed_messages`: each message is compressed by itself. Memory holds one chunk at a time, and the tables.
    """
    with path.open('rb') as file:
        return _Walk(file, compressed_messages).facts()


@dataclasses.dataclass
class _Descriptions:
    """Schemas and channels of one part of a file, by id: type, and (topic, id of the schema, the rest)."""

    schemas: dict[int, str] = dataclasses.field(default_factory=dict)
    channels: dict[int, tuple[str, int, bytes]] = dataclasses.field(default_factory=dict)

    def add(self, kind: int, body: bytes) -> None:
        fields = Fields(body)
        if kind == SCHEMA:
            (number,) = fields.take('<H')
            name = fields.text()
            if self.schemas.setdefault(number, name) != name:
                raise Damage(f'two schemas of id {number}')
        else:
            number, schema = fields.take('<HH')
            channel = (fields.text(), schema, fields.rest())
            if self.channels.setdefault(number, channel) != channel:
                raise Damage(f'two channels of id {number}')


class _Walk:
    """The records of a file, in one pass."""

    def __init__(self, file: BinaryIO, compressed_messages: bool) -> None:
        self._file = file
        self._compressed_messages = compressed_messages
        self._data, self._summary = _Descriptions(), _Descriptions()
        self._described_bytes = 0
        self._chunks: dict[int, tuple[Chunk, int, Counter[int]]] = {}
        """By place in the file: head, length with its head, and messages of each channel."""
        self._indices: list[bytes] = []
        self._outside: Counter[int] = Counter()
        """Messages of each channel that are in no chunk."""
        self._first_ns, self._last_ns = 2**64, -1
        self._data_end: Record | None = None

    def facts(self) -> BagFacts:
        for record in top_records(self._file):
            try:
                self._take(record)
            except Damage as damage:
                raise Damage(f'record of kind 0x{record.kind:02x} at byte {record.start}: {damage}') from None
        counts: Counter[int] = sum((counts for _, _, counts in self._chunks.values()), Counter(self._outside))
        self._check_tables(counts)
        topics: Counter[tuple[str, str]] = Counter()
        for number, count in counts.items():
            topic, schema, _ = self._channel(number)
            topics[topic, self._schema(schema)] += count
        return BagFacts(topics, self._first_ns if counts else 0, self._last_ns + 1)

    def _take(self, record: Record) -> None:
        if record.kind in (SCHEMA, CHANNEL):
            body = body_of(self._file, record)
            self._describe(self._summary if self._data_end else self._data, record.kind, body)
        elif record.kind == MESSAGE:
            self._outside[self._message(body_of(self._file, record), 0, record.length)[0]] += 1
        elif record.kind == CHUNK:
            self._chunk(record)
        elif record.kind == CHUNK_INDEX:
            self._indices.append(body_of(self._file, record))
        elif record.kind == DATA_END:
            self._data_end = record
            (checksum,) = Fields(body_of(self._file, record)).take('<I')
            self._require_checksum(checksum, 0, record.start)
        elif record.kind == FOOTER:
            self._footer(record)

    def _footer(self, record: Record) -> None:
        summary_start, _, checksum = Fields(body_of(self._file, record)).take('<QQI')
        if summary_start and (self._data_end is None or summary_start != self._data_end.end):
            raise Damage('its summary is not where it says')
        if summary_start:
            self._require_checksum(checksum, summary_start, record.body + CHECKSUM_IN_FOOTER)

    def _require_checksum(self, checksum: int, start: int, end: int) -> None:
        if checksum and checksum_of(self._file, start, end) != checksum:
            raise Damage(f'the checksum of bytes {start} to {end} is wrong')

    def _describe(self, descriptions: _Descriptions, kind: int, body: bytes) -> None:
        self._described_bytes += len(body)
        descriptions.add(kind, body)
        if self._described_bytes > MAX_DESCRIPTIONS_BYTES or len(descriptions.channels) > MAX_CHANNELS:
            raise Damage(f'more than {MAX_CHANNELS} topics, or {MAX_DESCRIPTIONS_BYTES} bytes of their descriptions')

    def _chunk(self, record: Record) -> None:
        head, content = open_chunk(body_of(self._file, record))
        counts: Counter[int] = Counter()
        first_ns, last_ns = 2**64, -1
        for inner in inner_records(content):
            if inner.kind == MESSAGE:
                channel, log_ns = self._message(content, inner.body, inner.length)
                counts[channel] += 1
                first_ns, last_ns = min(first_ns, log_ns), max(last_ns, log_ns)
            elif inner.kind in (SCHEMA, CHANNEL):
                self._describe(self._data, inner.kind, content[inner.body : inner.end])
            elif inner.kind == CHUNK:
                raise Damage('a chunk within a chunk')
        if counts and not head.start_ns <= first_ns <= last_ns <= head.end_ns:
            raise Damage('its messages are of another time than it says')
        self._chunks[record.start] = head, record.end - record.start, counts

    def _message(self, content: bytes, at: int, length: int) -> tuple[int, int]:
        """Channel and log time of the message whose body is at `at`."""
        if length < _MESSAGE_HEAD:
            raise Damage('a message that is too short')
        channel, _, log_ns = struct.unpack_from('<HIQ', content, at)
        self._first_ns, self._last_ns = min(self._first_ns, log_ns), max(self._last_ns, log_ns)
        if self._compressed_messages:
            try:
                inflate_message(content[at + _MESSAGE_HEAD : at + length])
            except ValueError as error:
                raise Damage(str(error)) from error
        return channel, log_ns

    def _check_tables(self, counts: Counter[int]) -> None:
        """Damage unless the summary, if there is one, leads to every message."""
        if self._data_end is None:
            raise Damage('it has no end of its data')
        for kept, found in (
            (self._summary.channels, self._data.channels),
            (self._summary.schemas, self._data.schemas),
        ):
            if any(kept[number] != found[number] for number in kept.keys() & found.keys()):
                raise Damage('a topic of its summary is not that of its data')
        if self._summary.schemas and counts.keys() - self._summary.channels.keys():
            raise Damage('its summary does not name a topic that has messages')
        if not self._indices:
            return
        if self._outside:
            raise Damage('messages that its index does not lead to')
        indexed: set[int] = set()
        for body in self._indices:
            indexed.add(self._check_index(Fields(body)))
        if len(indexed) != len(self._indices) or any(
            counts for start, (_, _, counts) in self._chunks.items() if start not in indexed
        ):
            raise Damage('chunks that its index does not lead to')

    def _check_index(self, fields: Fields) -> int:
        """Place of the chunk that an entry of the index is of; Damage unless it says of it what is true."""
        start_ns, end_ns, start, length = fields.take('<QQQQ')
        offsets = Fields(fields.part())
        places = []
        while rest := offsets.left:
            if rest < 10:
                raise Damage('a damaged index')
            channel, offset = offsets.take('<HQ')
            places.append((offset, channel))
        (index_length,) = fields.take('<Q')
        compression = fields.text()
        compressed_size, size = fields.take('<QQ')
        if start not in self._chunks:
            raise Damage(f'its index names a chunk at byte {start} that is not there')
        head, found_length, counts = self._chunks[start]
        said = (start_ns, end_ns, length, compression, compressed_size, size)
        if said != (head.start_ns, head.end_ns, found_length, head.compression, head.compressed_size, head.size):
            raise Damage(f'its index says of the chunk at byte {start} what is not so')
        # A reader takes the number of messages from where the index of the next channel begins; 0 leaves the chunk out.
        places.sort()
        ends = [offset for offset, _ in places[1:]] + [start + length + index_length]
        indexed = {channel for (at, channel), end in zip(places, ends, strict=False) if end - at >= _INDEX_BYTES}
        if counts.keys() - indexed:
            raise Damage(f'its index does not name a topic of the chunk at byte {start}')
        return start

    def _channel(self, number: int) -> tuple[str, int, bytes]:
        found = self._data.channels.get(number) or self._summary.channels.get(number)
        if found is None:
            raise Damage(f'messages of channel {number}, which is not described')
        return found

    def _schema(self, number: int) -> str:
        return self._data.schemas.get(number) or self._summary.schemas.get(number) or ''
