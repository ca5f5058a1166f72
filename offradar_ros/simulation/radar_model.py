"""From a world and a moving radar to one polar scan.

Model: each azimuth is one ray from where the radar then is. A wall returns by its face's angle to the ray and hides
what is behind it but for the share that passes it; poles, trees and cars return equally on all sides; everything falls
with range. Returns spread over the beam's width and a range cell, lie on clutter from the ground and on receiver noise,
and are multiplied by speckle. The recorded byte is power in half decibels.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.simulation.degradation import Degradation, degrade
from offradar_ros.simulation.reflectors import Reflectors
from offradar_ros.simulation.sensor import SimulatedSensor

Array = NDArray[np.float64]

_REFERENCE_M = 10.0
"""Range that powers of the world are given for."""

_FALL = 1.2
"""Returns fall with this power of range, as the upper quantiles of recorded scans do between 5 m and 160 m."""

_SEEN_WALLS = 3
"""A ray is followed through this many walls."""

_VEHICLE_M = 2.4
"""The radar's own vehicle returns from nearer than this."""

_GROUND = 1.0
"""Clutter from the ground at the reference range."""


class RadarModel:
    """Renders scans for one sensor."""

    def __init__(self, sensor: SimulatedSensor) -> None:
        self.sensor = sensor
        self._cell_m = sensor.bins_per_cell * sensor.range_resolution_m
        self._cells = -(-sensor.range_bins // sensor.bins_per_cell)
        self.azimuths_rad: Array = np.arange(sensor.azimuths, dtype=np.float64) * (2.0 * np.pi / sensor.azimuths)
        ranges_m = (np.arange(self._cells) + 0.5) * self._cell_m
        self._clutter = (_GROUND * (_REFERENCE_M / np.maximum(ranges_m, 4.0)) ** 2).astype(np.float32)
        self._clutter[ranges_m < _VEHICLE_M] = 10.0**2.0
        self._noise = np.float32(10.0 ** (sensor.noise_decibels / 10.0))
        row_rad = 2.0 * np.pi / sensor.azimuths
        self._beam = _with_skirt(sensor.beam_width_rad / 2.355 / row_rad, 0.1 / row_rad)
        self._spread = _with_skirt(0.18 / self._cell_m, 1.2 / self._cell_m)

    def render(
        self, reflectors: Reflectors, poses: Array, rng: np.random.Generator, degradation: Degradation | None = None
    ) -> NDArray[np.uint8]:
        """(A, R) uint8 power, seen from (A, 3) poses x, y, heading: one for each azimuth, as the radar moves on."""
        near = reflectors.within(poses[len(poses) // 2, :2], self.sensor.max_range_m + 5.0)
        power = np.zeros(self.sensor.azimuths * self._cells)
        hits_m, left = self._add_walls(power, near, poses)
        self._add_scatterers(power, near, poses, hits_m, left)
        signal = self._blurred(power.reshape(-1, self._cells).astype(np.float32)) + self._clutter
        noise = np.full_like(signal, self._noise)
        if degradation:
            signal, noise = degrade(signal, noise, degradation, round(4.0 / self._cell_m))
        received = signal * self._speckle(rng) + noise * rng.standard_exponential(signal.shape, np.float32)
        half_decibels = np.log10(received + np.float32(1e-6)) * np.float32(20.0)
        return self._recorded(half_decibels)

    def _add_walls(self, power: Array, near: Reflectors, poses: Array) -> tuple[Array, Array]:
        """Add walls' returns to flat (A·C,) `power`.

        Returns the (A, 3) ranges of the walls that each ray passes, nearest first, and the (A, 4) share of the power
        that is left after 0, 1, … of them.
        """
        angle = poses[:, 2] - self.azimuths_rad
        ray_x, ray_y = np.cos(angle)[:, None], np.sin(angle)[:, None]
        along = near.walls_m[:, 1] - near.walls_m[:, 0]
        from_x, from_y = (near.walls_m[None, :, 0, axis] - poses[:, axis, None] for axis in range(2))
        across = ray_x * along[:, 1] - ray_y * along[:, 0]
        with np.errstate(divide='ignore', invalid='ignore'):
            range_m = (from_x * along[:, 1] - from_y * along[:, 0]) / across
            fraction = (from_x * ray_y - from_y * ray_x) / across
        rows, walls = np.nonzero(
            (range_m > 0.5) & (range_m < self.sensor.max_range_m) & (fraction >= 0) & (fraction <= 1)
        )
        range_m = range_m[rows, walls]
        order = np.lexsort((range_m, rows))
        rows, walls, range_m = rows[order], walls[order], range_m[order]
        passed = np.arange(len(rows)) - np.searchsorted(rows, rows)
        seen = passed < _SEEN_WALLS
        rows, walls, range_m, passed = rows[seen], walls[seen], range_m[seen], passed[seen]
        hits_m = np.full((len(poses), _SEEN_WALLS), np.inf)
        hits_m[rows, passed] = range_m
        # Column k: share of the power that is left after k walls.
        left = np.ones((len(poses), _SEEN_WALLS + 1))
        left[rows, passed + 1] = near.wall_through[walls]
        left = np.cumprod(left, axis=1)
        incidence = np.abs(across[rows, walls]) / np.hypot(*along[walls].T)
        returned = near.wall_powers[walls] * (0.03 + 0.97 * incidence**6) * left[rows, passed]
        self._add(power, rows, range_m, returned)
        return hits_m, left

    def _add_scatterers(self, power: Array, near: Reflectors, poses: Array, hits_m: Array, left: Array) -> None:
        """Each scatterer returns on the azimuth that points at it when the radar looks there."""
        middle = np.broadcast_to(poses[len(poses) // 2], (len(near.scatterers_m), 3))
        rows, _ = _seen_from(middle, near.scatterers_m, len(poses))
        rows, range_m = _seen_from(poses[rows], near.scatterers_m, len(poses))
        passed = np.sum(hits_m[rows] < range_m[:, None], axis=1)
        self._add(power, rows, range_m, near.scatterer_powers * left[rows, passed])

    def _add(self, power: Array, rows: NDArray[np.intp], range_m: Array, returned: Array) -> None:
        cells = (range_m / self._cell_m).astype(np.intp)
        inside = cells < self._cells
        falling = (_REFERENCE_M / np.maximum(range_m, 2.0)) ** _FALL
        flat = rows[inside] * self._cells + cells[inside]
        power += np.bincount(flat, (returned * falling)[inside], len(power))

    def _blurred(self, power: NDArray[np.float32]) -> NDArray[np.float32]:
        margin = len(self._beam) // 2
        turned = np.concatenate([power[-margin:], power, power[:margin]]) if margin else power
        blurred = cv2.sepFilter2D(turned, cv2.CV_32F, self._spread, self._beam, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(blurred[margin : margin + len(power)], np.float32)

    def _speckle(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """Mean 1, alike over neighbouring azimuths as the beam overlaps them."""
        looks = rng.standard_exponential((self.sensor.azimuths, self._cells), np.float32)
        overlapping: NDArray[np.float32] = (looks + np.roll(looks, 1, axis=0)) * np.float32(0.5)
        return overlapping

    def _recorded(self, half_decibels: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Cells to range bins, rounded to bytes."""
        sensor = self.sensor
        if sensor.bins_per_cell > 1:
            size = (self._cells * sensor.bins_per_cell, sensor.azimuths)
            half_decibels = np.asarray(cv2.resize(half_decibels, size, interpolation=cv2.INTER_LINEAR), np.float32)
        return np.clip(np.rint(half_decibels[:, : sensor.range_bins]), 0, 255).astype(np.uint8)


def _seen_from(poses: Array, points_m: Array, azimuths: int) -> tuple[NDArray[np.intp], Array]:
    """(S,) row that looks at each of (S, 2) points from its pose, and the range."""
    offset = points_m - poses[:, :2]
    clockwise = poses[:, 2] - np.arctan2(offset[:, 1], offset[:, 0])
    rows = np.rint(clockwise / (2.0 * np.pi) * azimuths).astype(np.intp) % azimuths
    return rows, np.hypot(offset[:, 0], offset[:, 1])


def _with_skirt(sigma: float, skirt_sigma: float) -> NDArray[np.float32]:
    """A lobe of standard deviation `sigma` steps with the wide side lobes, 25 dB down, of strong returns."""
    reach = int(np.ceil(2.5 * skirt_sigma))
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (steps / sigma) ** 2) + 0.003 * np.exp(-0.5 * (steps / skirt_sigma) ** 2)
    return np.asarray(weights / weights.sum(), np.float32)
