"""What a place keeps of its scan to be aligned with: a small polar image, and when each of its rows was measured."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.twist import Twist
from offradar_ros.config import PolarGridConfig
from offradar_ros.errors import ConfigError
from offradar_ros.radar.polar_grid import PolarToGrid
from offradar_ros.types import PolarScan

BRIGHTEST = 15
"""Highest level of a cell: four bits say as much about where a scan was taken as eight."""
LONGEST_TURN_S = 10.0
"""When the rows of a slower turn were measured counts as unknown."""
_GRID = PolarGridConfig(azimuths=200, range_bins=80, resolution_m=1.0, min_range_m=4.0)
_FEWEST_ROWS = 8
"""With fewer, how far apart rows are measured is unknown."""
_MOST_CELLS, _MOST_ROWS, _LONGEST_ROW = 16_000, 720, 160


@dataclasses.dataclass(frozen=True)
class SignatureConfig:
    """How a scan becomes a signature. Two signatures can be aligned if they were made alike.

    ConfigError for numbers that are not finite or make no image, and for more cells than 8 KB hold.

    Attributes:
        grid: its rows and columns; what is nearer than `min_range_m` is the vehicle itself.
        above_noise: bytes (half decibels) above the noise of its row from which a return is seen.
        span: bytes above that at which it is as bright as can be.
    """

    grid: PolarGridConfig = _GRID
    above_noise: float = 8.0
    span: float = 60.0

    def __post_init__(self) -> None:
        grid = self.grid
        allowed = {
            'azimuths': 8 <= grid.azimuths <= min(_MOST_ROWS, _MOST_CELLS / max(grid.range_bins, 1)),
            'range_bins': 8 <= grid.range_bins <= _LONGEST_ROW,
            'resolution_m': 0.1 <= grid.resolution_m <= 10.0,
            'min_range_m': 0.0 <= grid.min_range_m < self.reach_m / 2.0,
            'above_noise': 0.0 <= self.above_noise <= 255.0,
            'span': 1.0 <= self.span <= 255.0,
        }
        wrong = [name for name, is_allowed in allowed.items() if not is_allowed]
        if wrong:
            raise ConfigError(f'a signature cannot be made with {", ".join(wrong)} of {self}')

    @property
    def reach_m(self) -> float:
        """Range of the last column's far edge."""
        return self.grid.range_bins * self.grid.resolution_m


SIGNATURE = SignatureConfig()


@dataclasses.dataclass(frozen=True, eq=False)
class Signature:
    """A small image of a scan.

    Convention: as that of `PolarToGrid`.

    Attributes:
        image: (A, C) uint8, levels of power above the noise of its row, 0 for none to `BRIGHTEST`.
        seen: (A,) bool, whether the scan has this sector.
        start_s: seconds from the stamp of the scan to when the sensor pointed forward; 0 if unknown.
        turn_s: seconds that a turn takes, negative if it turns counter-clockwise; 0 if unknown.
        twist: velocity of the vehicle at the stamp; None if unknown.
        config: how it was made.
    """

    image: NDArray[np.uint8]
    seen: NDArray[np.bool_]
    start_s: float = 0.0
    turn_s: float = 0.0
    twist: Twist | None = None
    config: SignatureConfig = SIGNATURE


class SignatureMaker:
    """Makes signatures of scans. What depends on the geometry of a scan is computed again only when that changes."""

    def __init__(self, config: SignatureConfig = SIGNATURE) -> None:
        self.config = config
        self._grid = PolarToGrid(config.grid)

    def __call__(self, scan: PolarScan) -> Signature:
        """The signature of a scan; rows without any power were not measured."""
        power = self._grid(_measured(scan)).astype(np.float32)
        blank = math.ceil(self.config.grid.min_range_m / self.config.grid.resolution_m)
        noise = np.median(power[:, blank:], axis=1, keepdims=True)
        above = np.clip((power - noise - self.config.above_noise) * (BRIGHTEST / self.config.span), 0.0, BRIGHTEST)
        start_s, turn_s = _sweep(scan)
        return Signature(np.rint(above).astype(np.uint8), np.any(power, axis=1), start_s, turn_s, config=self.config)


def _measured(scan: PolarScan) -> PolarScan:
    """The scan without its rows of zeros, which would darken the sectors that they share with others."""
    rows = scan.power.any(axis=1)
    if rows.all() or np.count_nonzero(rows) < _FEWEST_ROWS:
        return scan
    return dataclasses.replace(
        scan, power=scan.power[rows], azimuths_rad=scan.azimuths_rad[rows], azimuth_stamps_ns=None
    )


def _sweep(scan: PolarScan) -> tuple[float, float]:
    """When the sensor pointed forward, after the stamp, and how long a turn takes, by least squares; 0 if unknown."""
    if scan.azimuth_stamps_ns is None or len(scan.azimuths_rad) < 2:
        return 0.0, 0.0
    seconds = (scan.azimuth_stamps_ns - scan.stamp_ns) / 1e9
    turns = np.unwrap(scan.azimuths_rad) / (2.0 * math.pi)
    spread = turns - turns.mean()
    if not spread.any():
        return 0.0, 0.0
    turn_s = float(spread @ (seconds - seconds.mean()) / (spread @ spread))
    start_s = float(seconds.mean() - turn_s * turns.mean())
    return (start_s, turn_s) if max(abs(start_s), abs(turn_s)) <= LONGEST_TURN_S else (0.0, 0.0)
