"""Decompression within bounds: what claims to be small, and is not, ends at its claim."""

from __future__ import annotations

from backports import zstd
from lz4.frame import LZ4FrameDecompressor

MAX_BYTES = 256 * 1024**2
"""Largest chunk or message of a bag."""


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
