"""Scans for tests: random ones and recorded ones."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.types import PolarScan


def _cdr_image(raw: bytes) -> dict[str, object]:
    """Fields of a sensor_msgs/Image, parsed from little-endian CDR bytes."""
    at = 4

    def uint32() -> int:
        nonlocal at
        at = 4 + -(-(at - 4) // 4) * 4
        (value,) = struct.unpack_from('<I', raw, at)
        at += 4
        return int(value)

    def string() -> str:
        nonlocal at
        length = uint32()
        text = raw[at : at + length - 1].decode()
        at += length
        return text

    seconds, nanoseconds = uint32(), uint32()
    string()
    height, width = uint32(), uint32()
    encoding = string()
    at += 1
    step = uint32()
    size = uint32()
    stamp_ns = seconds * 10**9 + nanoseconds
    fields = {'height': height, 'width': width, 'encoding': encoding, 'step': step, 'stamp_ns': stamp_ns}
    return {**fields, 'data': raw[at : at + size]}


@pytest.fixture(scope='session')
def live_image(real_data: Path) -> dict[str, object]:
    """Arguments of `decode_polar_image` from a live driver's message."""
    return _cdr_image((real_data / 'navtech_ros2' / 'b_scan_image.cdr').read_bytes())


@pytest.fixture
def make_scan() -> Callable[..., PolarScan]:
    """Makes scans of random power with equidistant azimuths."""

    def make(rows: int = 400, bins: int = 600, resolution_m: float = 0.175, seed: int = 0) -> PolarScan:
        power = np.random.default_rng(seed).integers(0, 256, (rows, bins)).astype(np.uint8)
        return PolarScan(
            1_600_000_000_000_000_000, power, np.linspace(0.0, 2 * np.pi, rows, endpoint=False), resolution_m
        )

    return make
