"""A turn of the sensor on the spot: an exact roll of the polar rows, where a Cartesian image would be interpolated."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.types import PolarScan


def spin(scan: PolarScan, rows: int) -> PolarScan:
    """`scan` with everything in it moved clockwise by `rows` azimuths (the "spinning" augmentation of BCRadar).

    The azimuths of the rows stay; power and row stamps move. Exact for a full rotation of even steps: it equals a turn
    of the sensor by ``rows · 2π / A`` counter-clockwise.
    """
    stamps = scan.azimuth_stamps_ns
    return dataclasses.replace(
        scan,
        power=np.roll(scan.power, rows, axis=0),
        azimuth_stamps_ns=None if stamps is None else np.roll(stamps, rows),
    )
