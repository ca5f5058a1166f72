"""Power that the ground returns: flat ground in patches, and slopes that rise into the beam.

Patches and slopes are fixed in the world. A slope returns where the ground rises along the ray: a hillside is seen from
below, and over its whole area.
"""

from __future__ import annotations

import functools
import statistics

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.physics import RadarPhysics, linear_power
from offradar_ros.lab.simulation.rays import Hits, Rows

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_PATCH_M = 2.0
_GRAIN_M = 1.0
_HEIGHT_M = 4.0
"""Sides of the squares of the three textures: patches, grains of a slope, and heights."""

_SQUARES = 512
_HILL_SQUARES = 6.0
"""Standard deviation of the filter that smooths heights, in squares."""

_STEP = (2, 4)
"""The ground is computed for every second azimuth and every fourth cell."""


class Terrain:
    """The ground of one world, for scans of `azimuths` × `cells` of `cell_m` metres; `seed` moves its textures."""

    def __init__(self, azimuths: int, cells: int, cell_m: float, physics: RadarPhysics, seed: int) -> None:
        self._size = (cells, azimuths)
        self._rows = np.arange(0, azimuths, _STEP[0])
        self._bearings = self._rows * (2.0 * np.pi / azimuths)
        self._ranges_m: Array = (np.arange(0.0, cells, _STEP[1]) + _STEP[1] / 2) * cell_m
        self._spread = 0.23 * physics.ground_patch_db
        self._slope = linear_power(physics.slope_db) if physics.slope_share else 0.0
        self._rise = statistics.NormalDist().inv_cdf(1.0 - physics.slope_share) if physics.slope_share else np.inf
        self._moved_m = np.random.default_rng([seed, 9]).uniform(0.0, _SQUARES * _GRAIN_M, 2)

    def power(self, hits: Hits, poses: Array) -> Image:
        """(A, C) power relative to the mean of flat ground at that range, behind walls less; `poses` is (A, 3)."""
        angle = poses[self._rows, 2] - self._bearings
        x = self._moved_m[0] + poses[self._rows, 0, None] + self._ranges_m * np.cos(angle)[:, None]
        y = self._moved_m[1] + poses[self._rows, 1, None] + self._ranges_m * np.sin(angle)[:, None]
        ground = np.exp(np.float32(self._spread) * _at(_patches(), x, y, _PATCH_M) - np.float32(self._spread**2 / 2))
        if self._slope:
            rise = np.gradient(_at(_heights(), x, y, _HEIGHT_M), axis=1)
            rise /= np.float32(_typical_rise(float(self._ranges_m[1] - self._ranges_m[0])))
            facing = np.clip(rise - np.float32(self._rise), 0.0, 1.0)
            ground += np.float32(self._slope) * facing * _at(_grains(), x, y, _GRAIN_M)
        return self._fine(_behind_walls(ground, hits, self._rows, self._ranges_m))

    def _fine(self, coarse: Image) -> Image:
        """Interpolated to all azimuths and cells; azimuths wrap around."""
        wrapped = np.pad(coarse, ((1, 1), (0, 0)), mode='wrap')
        cells, azimuths = self._size
        size = (cells, azimuths + 2 * _STEP[0])
        return np.asarray(cv2.resize(wrapped, size, interpolation=cv2.INTER_LINEAR), np.float32)[_STEP[0] : -_STEP[0]]


def _behind_walls(ground: Image, hits: Hits, rows: Rows, ranges_m: Array) -> Image:
    wall_ranges_m, behind = hits.wall_ranges_m[rows], hits.transmission_behind[rows].astype(np.float32)
    for depth in range(int(np.isfinite(wall_ranges_m).any(axis=0).sum())):
        lost = behind[:, depth] - behind[:, depth + 1]
        ground -= np.where(ranges_m >= wall_ranges_m[:, depth, None], lost[:, None], 0.0) * ground
    return ground


def _at(texture: Image, x: Array, y: Array, square_m: float) -> Image:
    """Values of a periodic texture at points of the world, interpolated."""
    column, row = (np.mod(v / square_m, _SQUARES).astype(np.float32) for v in (x, y))
    return np.asarray(cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.float32)


@functools.lru_cache(maxsize=1)
def _patches() -> Image:
    """Of mean 0 and standard deviation 1, at two scales."""
    white = np.random.default_rng(20).standard_normal((_SQUARES, _SQUARES)).astype(np.float32)
    return _unit(_unit(_smoothed(white, 1.0)) + _unit(_smoothed(white, 8.0)))


@functools.lru_cache(maxsize=1)
def _grains() -> Image:
    """Of mean 1, exponentially distributed: bushes and boulders."""
    return np.random.default_rng(21).exponential(1.0, (_SQUARES, _SQUARES)).astype(np.float32)


@functools.lru_cache(maxsize=1)
def _heights() -> Image:
    """Of standard deviation 1; only its slopes matter."""
    white = np.random.default_rng(22).standard_normal((_SQUARES, _SQUARES)).astype(np.float32)
    return _unit(_smoothed(white, _HILL_SQUARES))


@functools.lru_cache(maxsize=16)
def _typical_rise(step_m: float) -> float:
    """Standard deviation of the difference of heights over `step_m`."""
    heights = _heights()
    per_square = heights - np.roll(heights, 1, axis=1)
    return float(per_square.std()) * step_m / _HEIGHT_M


def _smoothed(white: Image, sigma: float) -> Image:
    """A periodic Gaussian filter."""
    margin = 64
    tiled = np.pad(white, margin, mode='wrap')
    return np.asarray(cv2.GaussianBlur(tiled, (0, 0), sigma)[margin:-margin, margin:-margin], np.float32)


def _unit(image: Image) -> Image:
    return np.asarray(image / image.std(), np.float32)
