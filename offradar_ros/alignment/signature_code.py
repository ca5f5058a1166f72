"""Signatures as bytes, as they travel with an embedding and lie in a map file.

A fixed header, little endian: mark, version, rows and columns, then metres of a column, blanked metres, levels of
power, when the rows were measured, and the velocity of the vehicle, NaN where it is unknown. Then, compressed with
zlib: a bit for each row that was seen, and four bits for each cell, column by column, since neighbours at the same
range are the most alike. Last the CRC-32 of all before it.
"""

from __future__ import annotations

import dataclasses
import math
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.signature import BRIGHTEST, LONGEST_TURN_S, Signature, SignatureConfig
from offradar_ros.alignment.twist import FASTEST, Twist
from offradar_ros.config import PolarGridConfig
from offradar_ros.errors import ConfigError, RefusedInput

MOST_BYTES = 8192
"""No packed signature is longer."""
_MARK, _VERSION = b'OSIG', 1
_NO_TWIST = (math.nan,) * 3
_START = struct.Struct('<4sB')
_HEADER = struct.Struct('<4sBHH9d')
_CHECKSUM = struct.Struct('<I')


def pack(signature: Signature) -> bytes:
    """The signature as at most `MOST_BYTES` bytes, from which `unpack` makes it again to the last bit."""
    config, grid = signature.config, signature.config.grid
    if signature.image.shape != (grid.azimuths, grid.range_bins) or signature.seen.shape != (grid.azimuths,):
        raise ValueError(f'expected a signature of {grid.azimuths} × {grid.range_bins}, got {signature.image.shape}')
    if signature.image.max() > BRIGHTEST:
        raise ValueError(f'expected levels of at most {BRIGHTEST}, got {signature.image.max()}')
    header = _HEADER.pack(
        _MARK,
        _VERSION,
        grid.azimuths,
        grid.range_bins,
        grid.resolution_m,
        grid.min_range_m,
        config.above_noise,
        config.span,
        signature.start_s,
        signature.turn_s,
        *(dataclasses.astuple(signature.twist) if signature.twist else _NO_TWIST),
    )
    content = header + zlib.compress(np.packbits(signature.seen).tobytes() + _halves(signature.image).tobytes())
    return content + _CHECKSUM.pack(zlib.crc32(content))


def unpack(content: bytes) -> Signature:
    """The signature that `pack` made these bytes of; RefusedInput('invalid_signature') for any others."""
    if len(content) > MOST_BYTES:
        raise _refused(f'{len(content)} bytes, expected at most {MOST_BYTES}')
    if len(content) < _HEADER.size + _CHECKSUM.size:
        raise _refused(f'{len(content)} bytes, expected at least {_HEADER.size + _CHECKSUM.size}')
    mark, version = _START.unpack_from(content)
    if mark != _MARK:
        raise _refused(f'it starts with {mark!r}, expected {_MARK!r}')
    if version != _VERSION:
        raise _refused(f'form {version}, expected {_VERSION}: it was made by another version of offradar_ros')
    content, checksum = content[: -_CHECKSUM.size], content[-_CHECKSUM.size :]
    if _CHECKSUM.unpack(checksum) != (zlib.crc32(content),):
        raise _refused('its checksum is wrong: it is truncated or damaged')
    values = _HEADER.unpack_from(content)[2:]
    azimuths, range_bins, resolution_m, min_range_m, above_noise, span, start_s, turn_s, *velocity = values
    try:
        grid = PolarGridConfig(azimuths, range_bins, resolution_m, min_range_m)
        config = SignatureConfig(grid, above_noise, span)
    except ConfigError as error:
        raise _refused(str(error)) from None
    # Not a number is not less than anything either.
    if not (abs(start_s) <= LONGEST_TURN_S and abs(turn_s) <= LONGEST_TURN_S):
        raise _refused(f'start_s {start_s:g} and turn_s {turn_s:g}, expected at most {LONGEST_TURN_S:g} s')
    twist = None if all(map(math.isnan, velocity)) else Twist(*velocity)
    if twist and not all(abs(value) <= FASTEST for value in velocity):
        raise _refused(f'a velocity of {twist}, expected at most {FASTEST:g}')
    bits = math.ceil(azimuths / 8)
    payload = _inflated(content[_HEADER.size :], bits + math.ceil(azimuths * range_bins / 2))
    seen = np.unpackbits(payload[:bits], count=azimuths).astype(np.bool_)
    return Signature(_levels(payload[bits:], azimuths, range_bins), seen, start_s, turn_s, twist, config)


def checksum_of(content: bytes) -> int:
    """The CRC-32 at the end of a packed signature, by which it is told from another; 0 for none."""
    return int.from_bytes(content[-_CHECKSUM.size :], 'little')


def is_of_checksum(content: bytes, checksum: int) -> bool:
    """Whether these bytes are the packed signature with this checksum, and whole; it may be of another version."""
    return checksum_of(content) == checksum == zlib.crc32(content[: -_CHECKSUM.size])


def _halves(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Two levels a byte, column by column."""
    levels = np.ascontiguousarray(image.T).ravel()
    levels = np.append(levels, np.zeros(len(levels) % 2, np.uint8))
    return np.asarray(levels[::2] << 4 | levels[1::2], np.uint8)


def _levels(halves: NDArray[np.uint8], azimuths: int, range_bins: int) -> NDArray[np.uint8]:
    """(A, C) levels of what `_halves` made."""
    levels = np.column_stack([halves >> 4, halves & 15]).ravel()[: azimuths * range_bins]
    return np.ascontiguousarray(levels.reshape(range_bins, azimuths).T)


def _inflated(compressed: bytes, expected: int) -> NDArray[np.uint8]:
    """Exactly `expected` bytes; never more are made, whatever the data holds."""
    inflater = zlib.decompressobj()
    try:
        payload = inflater.decompress(compressed, expected + 1)
    except zlib.error as error:
        raise _refused(f'it cannot be inflated ({error})') from None
    if len(payload) != expected or not inflater.eof or inflater.unused_data:
        raise _refused(f'it does not hold the {expected} bytes that its header says')
    return np.frombuffer(payload, np.uint8)


def _refused(reason: str) -> RefusedInput:
    return RefusedInput('invalid_signature', f'signature of a scan: {reason}; dropped')
