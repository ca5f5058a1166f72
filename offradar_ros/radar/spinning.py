"""The sensor turned on the spot: a roll of the polar rows, exact where a rotated Cartesian image would interpolate."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.types import PolarScan


def spin(scan: PolarScan, rows: int) -> PolarScan:
    """`scan` with everything in it moved clockwise by `rows` azimuths (the "spinning" augmentation of BCRadar).

    The azimuths of the rows stay; power, and the times it was measured at, move. Exact for a full rotation of even
    steps, where `rows` is a turn of the sensor by ``rows · 2π / A`` counter-clockwise.
    """
    stamps = scan.azimuth_stamps_ns
    return dataclasses.replace(
        scan,
        power=np.roll(scan.power, rows, axis=0),
        azimuth_stamps_ns=None if stamps is None else np.roll(stamps, rows),
    )
