"""Signatures as two fields of the points of a cloud: one a point, filled up with zeroes to the longest of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.signature_code import unpack
from offradar_ros.errors import RefusedInput
from offradar_ros.ros.clouds import Layout
from offradar_ros.types import MAX_SIGNATURE_BYTES

SIGNATURE = 'signature'
SIZE = 'signature_bytes'
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
    """The N packed signatures of (N,) points, each sound or empty; RefusedInput (`invalid_signature`) for others."""
    found: list[bytes] = []
    for size, row in zip(points[SIZE].tolist(), points[SIGNATURE], strict=True):
        content = row.tobytes()
        if size > len(content) or any(content[size:]):
            raise RefusedInput(
                'invalid_signature',
                f'{topic}: a signature of {size} bytes in a field of {len(content)}: expected as many at most, and '
                'zeroes after them',
            )
        signature = content[:size]
        # The rows that one scan changed hold the same one.
        if signature and signature not in found[-1:]:
            _require_sound(signature, topic)
        found.append(signature)
    return tuple(found)


def _require_sound(signature: bytes, topic: str) -> None:
    try:
        unpack(signature)
    except RefusedInput as problem:
        raise RefusedInput(problem.cause, f'{topic}: {problem}') from None
