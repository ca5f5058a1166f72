"""Decompression within bounds: what claims to be small, and is not, ends at its claim."""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

from backports import zstd
from lz4.frame import LZ4FrameDecompressor

MAX_BYTES = 256 * 1024**2
"""Largest chunk or message of a bag."""
MAX_FRAMES = 64
"""Most frames that follow each other. Writers make one of a chunk, and each costs a copy of all that comes after it."""
_PIECE = 1024**2
_TOO_MANY = f'more than {MAX_FRAMES} compressed frames, one after the other'


def inflate(data: bytes, compression: str, size: int) -> bytes:
    """The `size` bytes that `data` stands for.

    ValueError if they are more or fewer, more than `MAX_BYTES`, damaged or of an unknown `compression`.
    """
    if size > MAX_BYTES:
        raise ValueError(f'claims {size} bytes, more than {MAX_BYTES}')
    content = _inflated(data, compression, size)
    if len(content) != size:
        raise ValueError(f'expected {size} bytes, got {"more" if len(content) > size else len(content)}')
    return content


def inflate_message(data: bytes) -> bytes:
    """A message that was compressed by itself, with zstd; ValueError if it is damaged or larger than `MAX_BYTES`."""
    content = _inflated(data, 'zstd', MAX_BYTES)
    if len(content) > MAX_BYTES:
        raise ValueError(f'a message of more than {MAX_BYTES} bytes')
    return content


def inflated_pieces(file: BinaryIO) -> Iterator[bytes]:
    """The content of a file that was compressed as a whole with zstd, in pieces; ValueError if it is damaged."""
    data = file.read(_PIECE)
    for _ in range(MAX_FRAMES):
        decompressor = zstd.ZstdDecompressor()
        while not decompressor.eof:
            try:
                yield decompressor.decompress(data, _PIECE)
            except zstd.ZstdError as error:
                raise ValueError('damaged zstd data') from error
            data = file.read(_PIECE) if decompressor.needs_input else b''
            if decompressor.needs_input and not data:
                raise ValueError('truncated zstd data')
        data = decompressor.unused_data or file.read(_PIECE)
        if not data:
            return
    raise ValueError(_TOO_MANY)


def _inflated(data: bytes, compression: str, limit: int) -> bytes:
    """At most `limit` + 1 bytes: one more than allowed is enough to know."""
    if compression == '':
        return data[: limit + 1]
    parts: list[bytes] = []
    size = 0
    # Several frames may follow each other.
    while data and size <= limit:
        if compression not in ('zstd', 'lz4'):
            raise ValueError(f'unknown compression {compression[:20]!r}')
        if len(parts) == MAX_FRAMES:
            raise ValueError(_TOO_MANY)
        decompressor = zstd.ZstdDecompressor() if compression == 'zstd' else LZ4FrameDecompressor()
        try:
            parts.append(decompressor.decompress(data, limit + 1 - size))
        except (zstd.ZstdError, RuntimeError) as error:
            raise ValueError(f'damaged {compression} data') from error
        size += len(parts[-1])
        if size <= limit and not decompressor.eof:
            raise ValueError(f'truncated {compression} data')
        data = decompressor.unused_data or b''
    return parts[0] if len(parts) == 1 else b''.join(parts)
