"""Scans for the calibration of a compressed network, spread evenly over drives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.network_image import make_image
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.sequence import RadarSequence

SCANS = 64


@dataclasses.dataclass(frozen=True, eq=False)
class CalibrationScans:
    """Images of calibration scans.

    Attributes:
        images: (N, H, W) uint8, N ≥ 1.
        source: number of scans and names of their drives, for the description of the compressed network.
    """

    images: NDArray[np.uint8]
    source: str


def calibration_scans(drives: Sequence[RadarSequence], config: NetworkConfig, scans: int = SCANS) -> CalibrationScans:
    """The images of at most `scans` scans, spread evenly over the scans of all drives.

    Scans without signal are skipped. DataError if none remains, and as raised by the drives.
    """
    to_image = make_image(config)
    every = [(drive, index) for drive in drives for index in range(len(drive))]
    images = []
    for at in np.unique(np.linspace(0, len(every) - 1, min(scans, len(every))).round().astype(int)).tolist():
        drive, index = every[at]
        try:
            image = to_image(drive.scan(index))
        except RefusedInput:
            continue
        if image.any():
            images.append(image)
    names = ', '.join(drive.name for drive in drives)
    if not images:
        raise DataError(f'calibration drives {names}: expected at least one scan with signal, got none')
    return CalibrationScans(np.stack(images), f'{len(images)} scans of {names}')
