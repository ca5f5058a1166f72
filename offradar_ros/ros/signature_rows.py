"""Signatures as two fields of the points of a cloud: one a point, filled up with zeroes to the longest of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.signature_code import unpack
from offradar_ros.errors import RefusedInput
from offradar_ros.ros.clouds import Layout
from offradar_ros.types import MAX_SIGNATURE_BYTES

SIGNATURE = 'signature'
SIZE = 'signature_bytes'
MOST_DIFFERENT = 64
"""Most signatures in rows of the map; the rows that one scan changed hold the same one."""
MAX_COUNTS = {SIGNATURE: MAX_SIGNATURE_BYTES}
"""For `from_cloud`: a column is as long as the longest signature of the message."""


def signed_layout(layout: Layout, signatures: Sequence[bytes] = ()) -> Layout:
    """A point with room for any of these signatures."""
    columns = max(map(len, signatures), default=0)
    return np.dtype([*layout.descr, (SIZE, '<u2'), (SIGNATURE, 'u1', (max(columns, 1),))])


def write_signatures(points: NDArray[Any], signatures: Sequence[bytes]) -> None:
    """Fill the two fields of (N,) points with N packed signatures; empty for a scan that has none."""
    columns = points.dtype[SIGNATURE].shape[0]
    points[SIZE] = [len(signature) for signature in signatures]
    filled = b''.join(signature.ljust(columns, b'\0') for signature in signatures)
    points[SIGNATURE] = np.frombuffer(filled, np.uint8).reshape(len(points), columns)


def read_signatures(points: NDArray[Any], topic: str) -> tuple[bytes, ...]:
    """The bytes of the N signatures of (N,) points; RefusedInput (`invalid_signature`) if they do not fit their fields.

    Whether they are signatures is for `require_sound`, or for whoever takes them up.
    """
    found: list[bytes] = []
    for size, row in zip(points[SIZE].tolist(), points[SIGNATURE], strict=True):
        content = row.tobytes()
        if size > len(content) or any(content[size:]):
            raise RefusedInput(
                'invalid_signature',
                f'{topic}: a signature of {size} bytes in a field of {len(content)}: expected as many at most, and '
                'zeroes after them',
            )
        found.append(content[:size])
    return tuple(found)


def require_sound(signatures: Iterable[bytes], topic: str) -> None:
    """RefusedInput (`invalid_signature`) if one of these that is not empty is not a packed signature.

    `wrong_size` for more than `MOST_DIFFERENT` different ones: each takes a tenth of a millisecond to check.
    """
    different = {*signatures} - {b''}
    if len(different) > MOST_DIFFERENT:
        raise RefusedInput(
            'wrong_size', f'{topic}: rows with {len(different)} signatures: expected {MOST_DIFFERENT} at most'
        )
    for signature in different:
        try:
            unpack(signature)
        except RefusedInput as problem:
            raise RefusedInput(problem.cause, f'{topic}: {problem}') from None
