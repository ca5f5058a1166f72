"""Drives along a street that need no simulation, and whose descriptors are their positions."""

from __future__ import annotations

import dataclasses

import numpy as np
from street_sequence import StreetSequence

from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.types import PolarScan

COUNT = 16


def driven_street(lane_m: float, *, index: int = 0, backwards: bool = False) -> EmbeddedDrive:
    """A drive eastwards of 16 scans, 1.25 m apart; or the same, with truth that looks to the west."""
    street = StreetSequence(count=COUNT, lane_m=lane_m, noise_seed=round(10 * lane_m))
    along_m = 1.25 * np.arange(COUNT, dtype=np.float64)
    poses = np.column_stack([along_m, np.full(COUNT, lane_m), np.full(COUNT, np.pi if backwards else 0.0)])
    made = Drive(
        name=f'lane {lane_m:g}',
        group='streets',
        world='street',
        index=index,
        key=f'{lane_m:g}',
        stamps_ns=street.stamps_ns,
        poses=poses,
        driven_m=along_m,
        kinds=np.full(COUNT, ''),
        severities=np.zeros(COUNT),
        read_scan=street.scan,
    )
    means = np.column_stack([along_m, np.zeros(COUNT)]).astype(np.float32)
    return EmbeddedDrive(made, means, np.ones(COUNT))


def with_refused_scans(drive: EmbeddedDrive, refused: set[int], error: Exception) -> EmbeddedDrive:
    """The same drive, some of whose scans cannot be read."""

    def read(row: int) -> PolarScan:
        if row in refused:
            raise error
        return drive.drive.scan(row)

    return dataclasses.replace(drive, drive=dataclasses.replace(drive.drive, read_scan=read))
