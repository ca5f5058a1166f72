"""The records of an MCAP file, each within the bounds of the file.

A file is a magic, then records: a byte that says what it is, its length (8 bytes, little-endian) and its body. Chunks
are records that hold compressed records. https://mcap.dev/spec
"""

from __future__ import annotations

import dataclasses
import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO

from offradar_ros.recordings.bags.inflate import MAX_BYTES, inflate

MAGIC = b'\x89MCAP0\r\n'
HEAD = 9
"""Bytes before the body of a record."""
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x08, 0x0F

_PIECE = 1024**2
_FOOTER_BYTES = 20


@dataclasses.dataclass(frozen=True)
class Record:
    """A record: what it is, where it begins in the file, and the length of its body."""

    kind: int
    start: int
    length: int

    @property
    def body(self) -> int:
        """Where the body begins."""
        return self.start + HEAD

    @property
    def end(self) -> int:
        """Where the next record begins."""
        return self.start + HEAD + self.length


class Damage(ValueError):
    """The file is not as an MCAP file must be."""


class CutOff(Damage):
    """The file ends too early: recording was not ended, or it was not copied whole."""


def top_records(file: BinaryIO) -> Iterator[Record]:
    """All records of a file but those within chunks, up to its footer; Damage where one is not as it must be.

    The position in the file may be changed between them.
    """
    size = file.seek(0, 2)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise Damage('no MCAP file')
    at = len(MAGIC)
    while True:
        file.seek(at)
        head = file.read(HEAD)
        if len(head) < HEAD:
            raise CutOff('it ends without a footer')
        kind, length = struct.unpack('<BQ', head)
        record = Record(kind, at, length)
        if record.end > size:
            raise CutOff(f'the record at byte {at} would end at {record.end}, beyond the end of the file')
        if kind == 0 or (kind == FOOTER and length != _FOOTER_BYTES):
            raise Damage(f'a record at byte {at} that cannot be')
        yield record
        at = record.end
        if kind == FOOTER:
            break
    file.seek(at)
    if file.read(len(MAGIC) + 1) != MAGIC:
        raise Damage('it does not end after its footer')


def body_of(file: BinaryIO, record: Record) -> bytes:
    """The body of a record; Damage if it is larger than anything that is read may be."""
    if record.length > MAX_BYTES:
        raise Damage(f'the record at byte {record.start} has {record.length} bytes, more than {MAX_BYTES}')
    file.seek(record.body)
    return file.read(record.length)


@dataclasses.dataclass(frozen=True)
class Chunk:
    """The head of a chunk: log times of its messages, and how its records are compressed."""

    start_ns: int
    end_ns: int
    size: int
    checksum: int
    compression: str
    compressed_size: int


CHECKSUM_IN_CHUNK = 24
"""Where the checksum is in the body of a chunk."""


def open_chunk(body: bytes) -> tuple[Chunk, bytes]:
    """The head of a chunk and the records in it, decompressed; Damage if they are not as they must be."""
    fields = Fields(body)
    start_ns, end_ns, size, checksum = fields.take('<QQQI')
    head = Chunk(start_ns, end_ns, size, checksum, fields.text(), fields.take('<Q')[0])
    compressed = fields.rest()
    if len(compressed) != head.compressed_size:
        raise Damage(f'expected {head.compressed_size} compressed bytes, got {len(compressed)}')
    try:
        content = inflate(compressed, head.compression, head.size)
    except ValueError as error:
        raise Damage(str(error)) from error
    if head.checksum and zlib.crc32(content) != head.checksum:
        raise Damage('its checksum is wrong')
    return head, content


def inner_records(content: bytes) -> Iterator[Record]:
    """Records of the decompressed content of a chunk."""
    at = 0
    while at < len(content):
        if at + HEAD > len(content):
            raise Damage('a record is cut off')
        kind, length = struct.unpack_from('<BQ', content, at)
        record = Record(kind, at, length)
        if record.end > len(content):
            raise Damage('a record goes beyond its end')
        yield record
        at = record.end


class Fields:
    """Reads the fields of a body one after the other; Damage where it ends too early."""

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    @property
    def left(self) -> int:
        """Number of bytes that are left."""
        return len(self._body) - self._at

    def take(self, form: str) -> tuple[int, ...]:
        """Numbers, as of `struct`."""
        size = struct.calcsize(form)
        numbers: tuple[int, ...] = struct.unpack(form, self._part(size))
        return numbers

    def part(self) -> bytes:
        """Bytes after their length (4 bytes)."""
        return self._part(self.take('<I')[0])

    def text(self) -> str:
        """Text after its length."""
        try:
            return self.part().decode()
        except UnicodeDecodeError:
            raise Damage('a text that is not UTF-8') from None

    def rest(self) -> bytes:
        """All that is left."""
        return self._part(self.left)

    def _part(self, size: int) -> bytes:
        start, self._at = self._at, self._at + size
        if self._at > len(self._body):
            raise Damage('a field goes beyond the end of its record')
        return self._body[start : self._at]


def checksum_of(file: BinaryIO, start: int, end: int) -> int:
    """CRC-32 of the bytes from `start` to `end`."""
    file.seek(start)
    checksum, left = 0, end - start
    while left > 0:
        piece = file.read(min(left, _PIECE))
        if not piece:
            break
        checksum, left = zlib.crc32(piece, checksum), left - len(piece)
    return checksum
