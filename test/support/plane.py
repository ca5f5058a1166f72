"""Scans of reflectors in a plane, made without the simulator: each is a spot of the width of the beam."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.twist import STANDING, Twist
from offradar_ros.types import PolarScan

STAMP_NS = 1_700_000_000 * 10**9
TURN_S = 0.25
_BEAM_RAD = 0.016
_SPOT_M = 0.25


@dataclasses.dataclass(frozen=True, eq=False)
class Plane:
    """Reflectors at (N, 2) metres with (N,) powers in bytes."""

    points_m: NDArray[np.float64]
    powers: NDArray[np.float64]

    def scan(
        self,
        pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
        *,
        twist: Twist = STANDING,
        azimuths: int = 400,
        range_bins: int = 400,
        range_resolution_m: float = 0.25,
        range_offset_m: float = 0.0,
        seed: int = 0,
    ) -> PolarScan:
        """What a radar at x, y, yaw receives; `twist` is its velocity, and the stamp the middle of its turn."""
        turns = np.arange(azimuths) / azimuths
        seconds = TURN_S * (turns - 0.5)
        ranges_m = range_offset_m + (np.arange(range_bins) + 0.5) * range_resolution_m
        noise = np.random.default_rng(seed).normal(30.0, 3.0, (azimuths, range_bins))
        power = np.zeros((azimuths, range_bins))
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        seen = (self.points_m - np.array(pose[:2])) @ np.array([[cos, -sin], [sin, cos]])
        for row, t in enumerate(seconds.tolist()):
            at = seen - np.array([twist.forward_mps * t, twist.left_mps * t])
            bearing = np.arctan2(at[:, 1], at[:, 0]) - twist.yaw_radps * t
            # Azimuths are clockwise.
            off = np.angle(np.exp(1j * (bearing + 2.0 * math.pi * turns[row])))
            for index in np.flatnonzero(np.abs(off) < 4.0 * _BEAM_RAD):
                apart = (ranges_m - np.hypot(*at[index])) / _SPOT_M
                spot = np.exp(-0.5 * (apart**2 + (off[index] / _BEAM_RAD) ** 2))
                power[row] = np.maximum(power[row], self.powers[index] * spot)
        return PolarScan(
            stamp_ns=STAMP_NS,
            power=np.clip(noise + power, 0.0, 255.0).astype(np.uint8),
            azimuths_rad=2.0 * math.pi * turns,
            range_resolution_m=range_resolution_m,
            range_offset_m=range_offset_m,
            azimuth_stamps_ns=STAMP_NS + np.rint(seconds * 1e9).astype(np.int64),
        )


def make_plane(seed: int, reflectors: int = 160, reach_m: float = 90.0) -> Plane:
    """Reflectors all around."""
    rng = np.random.default_rng(seed)
    points_m = rng.uniform(-reach_m, reach_m, (reflectors, 2))
    return Plane(points_m[np.hypot(*points_m.T) > 8.0], rng.uniform(40.0, 120.0, reflectors)[: len(points_m)])


def make_walls(heading_rad: float = 0.0, reach_m: float = 100.0) -> Plane:
    """Two walls without end, 8 m to the right of a vehicle of this heading at the origin and 9 m to its left."""
    along_m = np.arange(-reach_m, reach_m, 0.2)
    points_m = np.concatenate([np.column_stack([along_m, np.full_like(along_m, y_m)]) for y_m in (-8.0, 9.0)])
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return Plane(points_m @ np.array([[cos, sin], [-sin, cos]]), np.full(len(points_m), 90.0))
