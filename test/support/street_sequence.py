"""A drive along a street, made without the simulation."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import GeoPoint, LocalFrame, Trajectory
from offradar_ros.types import PolarScan

ORIGIN = GeoPoint(51.75, -1.25, 70.0)
START_NS = 1_600_000_000_000_000_000
PERIOD_NS = 250_000_000


@dataclasses.dataclass(frozen=True)
class StreetSequence:
    """A drive eastwards, 1.25 m from scan to scan, past point reflectors, with fixes at 5 Hz.

    It is enough to be recognised again: each reflector becomes a block of pixels, nothing more. The scans `degraded`
    are noise; those of a `silent` radar are all zero.
    """

    count: int = 24
    start_ns: int = START_NS
    lane_m: float = 0.0
    noise_seed: int = 0
    degraded: tuple[int, ...] = ()
    silent: bool = False
    name: str = 'street'
    layout: str = 'test'

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        return self.start_ns + PERIOD_NS * np.arange(self.count, dtype=np.int64)

    def __len__(self) -> int:
        return self.count

    def position_m(self, index: float) -> tuple[float, float]:
        return 1.25 * index, self.lane_m

    @property
    def trajectory(self) -> Trajectory:
        times_s = np.arange(-1.0, self.count * 0.25 + 1.0, 0.2)
        east_north_up = np.stack([5.0 * times_s, np.full_like(times_s, self.lane_m), np.zeros_like(times_s)], axis=1)
        return Trajectory(
            self.start_ns + np.round(times_s * 1e9).astype(np.int64),
            LocalFrame(ORIGIN).to_geodetic(east_north_up),
            np.full(len(times_s), np.nan),
            geodetic=True,
        )

    def with_trajectory(self, trajectory: Trajectory | None) -> Repositioned:
        """The same scans with other positions, or without any."""
        return Repositioned(self, trajectory)

    def scan(self, index: int) -> PolarScan:
        noise = np.random.default_rng([self.noise_seed, index])
        power = noise.integers(0, 12, (400, 576), np.uint8)
        reflectors = np.random.default_rng(7).uniform((-120, -90), (150, 90), (120, 2))
        x, y = self.position_m(index)
        east, north = reflectors[:, 0] - x, reflectors[:, 1] - y
        bins = (np.hypot(east, north) / 0.1736).astype(int)
        rows = np.round(np.mod(-np.arctan2(north, east), 2 * np.pi) / (2 * np.pi) * 400).astype(int)
        for row, column in zip(rows, bins, strict=True):
            if 20 < column < 570:
                power[np.ix_(np.arange(row - 1, row + 2) % 400, np.arange(column - 3, column + 4))] = 180
        if index in self.degraded:
            power[:] = noise.integers(0, 200, power.shape, np.uint8)
        if self.silent:
            power[:] = 0
        return PolarScan(int(self.stamps_ns[index]), power, np.arange(400) / 400 * 2 * np.pi, 0.1736)


@dataclasses.dataclass(frozen=True)
class Repositioned:
    """The scans of a drive with other positions than its own, or without any."""

    drive: StreetSequence
    trajectory: Trajectory | None

    @property
    def name(self) -> str:
        return self.drive.name

    @property
    def layout(self) -> str:
        return self.drive.layout

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        return self.drive.stamps_ns

    def __len__(self) -> int:
        return len(self.drive)

    def scan(self, index: int) -> PolarScan:
        return self.drive.scan(index)
