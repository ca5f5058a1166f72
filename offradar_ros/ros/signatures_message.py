"""Scans whose signatures are wanted, and their signatures, as PointCloud2: the question and the answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2

from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.place_check import MAX_SESSION_ID
from offradar_ros.messages import stamp_ns
from offradar_ros.retrieval.received_signatures import MOST_WANTED
from offradar_ros.ros.clouds import Layout, from_cloud, to_cloud
from offradar_ros.ros.place_message import MAP_FRAME
from offradar_ros.ros.signature_rows import MAX_COUNTS, read_signatures, signed_layout, write_signatures
from offradar_ros.ros.stamps import header
from offradar_ros.types import ScanKey

SCAN = np.dtype([('session_id', '<u4'), ('stamp_sec', '<i4'), ('stamp_nanosec', '<u4')])
"""A scan as a point."""


def wanted_message(scans: Sequence[ScanKey], stamp_ns: int) -> PointCloud2:
    """A question for the signatures of these scans, 1 to `MOST_WANTED`."""
    return to_cloud(_points(scans, SCAN), header(stamp_ns, MAP_FRAME))


def wanted_record(message: PointCloud2, topic: str) -> tuple[ScanKey, ...]:
    """The scans of a question; RefusedInput if it is not one of ours, or of another number of scans."""
    return _scans(_read(message, SCAN, topic), topic)


def signatures_message(signatures: Mapping[ScanKey, bytes], stamp_ns: int) -> PointCloud2:
    """The answer: each scan with its packed signature, or an empty one, which says that it has none."""
    contents = list(signatures.values())
    points = _points(list(signatures), signed_layout(SCAN, contents))
    write_signatures(points, contents)
    return to_cloud(points, header(stamp_ns, MAP_FRAME))


def signatures_record(message: PointCloud2, topic: str) -> dict[ScanKey, bytes]:
    """The bytes of the signatures of an answer, which `ReceivedSignatures.receive` checks as it takes them up.

    RefusedInput as `wanted_record` and `read_signatures`.
    """
    points = _read(message, signed_layout(SCAN), topic, MAX_COUNTS)
    return dict(zip(_scans(points, topic), read_signatures(points, topic), strict=True))


def _points(scans: Sequence[ScanKey], layout: Layout) -> NDArray[Any]:
    points = np.empty(len(scans), layout)
    points['session_id'] = [scan.session_id for scan in scans]
    points['stamp_sec'], points['stamp_nanosec'] = np.divmod([scan.stamp_ns for scan in scans], 10**9)
    return points


def _read(
    message: PointCloud2, layout: Layout, topic: str, max_counts: Mapping[str, int] | None = None
) -> NDArray[Any]:
    stamp_ns(message.header.stamp)
    points = from_cloud(message, layout, topic, max_counts)
    # Each takes a tenth of a millisecond to take up.
    if not 0 < len(points) <= MOST_WANTED:
        raise RefusedInput('wrong_size', f'{topic}: {len(points)} scans: expected 1 to {MOST_WANTED}')
    return points


def _scans(points: NDArray[Any], topic: str) -> tuple[ScanKey, ...]:
    seconds, nanoseconds, sessions = (points[name] for name in ('stamp_sec', 'stamp_nanosec', 'session_id'))
    if (seconds < 0).any() or (nanoseconds >= 10**9).any() or (sessions > MAX_SESSION_ID).any():
        raise RefusedInput('invalid_place', f'{topic}: a scan has no valid stamp or session id')
    stamps = seconds.astype(np.int64) * 10**9 + nanoseconds
    return tuple(map(ScanKey, sessions.tolist(), stamps.tolist()))
