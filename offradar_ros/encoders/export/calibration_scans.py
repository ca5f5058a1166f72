"""Scans that a smaller copy of a network is fitted to, spread evenly over some drives."""

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
    """What a network sees of some scans.

    Attributes:
        images: (N, H, W) uint8, N ≥ 1.
        source: how many scans and of which drives, for the description of what is made with them.
    """

    images: NDArray[np.uint8]
    source: str


def calibration_scans(drives: Sequence[RadarSequence], config: NetworkConfig, scans: int = SCANS) -> CalibrationScans:
    """So many scans, as evenly over the scans of all drives as can be; all of them where there are fewer.

    Scans without signal are passed over. DataError where none remains, and as the drives raise it.
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
