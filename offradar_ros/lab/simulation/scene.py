"""Power of everything that returns, before the beam and the receiver: one value for each azimuth and range cell.

A wall returns by its face's angle to the ray, unevenly along its length, and hides what is behind it; poles, trees and
cars return equally on all sides; everything falls with range. Part of what meets a wall comes back late. Multipath adds
ghosts: strong returns again at two and three times their range, from laps between a wall that is met face on and the
vehicle, and everything again on the far side of the wall that mirrors best. The ground returns a little everywhere, in
patches that stay where they are.
"""

from __future__ import annotations

import functools
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.physics import RadarPhysics, ratio
from offradar_ros.lab.simulation.rays import Hits, Rows, cast_rays
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.weather import Weather

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_REFERENCE_M = 10.0
"""Range that powers of the world are given for."""

_VEHICLE_M = 2.4
"""The radar's own vehicle returns from nearer than this."""

_FACE_ON = 0.995
"""Cosine of incidence from which a wall and the vehicle are mirrors to each other."""

_ECHOES = 3
_PATCH_M = 2.0
_COARSER = (2, 4)
"""Ground clutter is worked out for every second azimuth and every fourth cell."""


class Scene:
    """Adds up returns for one size of scan, `azimuths` × `cells` of `cell_m` metres."""

    def __init__(self, azimuths: int, cells: int, cell_m: float, physics: RadarPhysics, weather: Weather) -> None:
        self._azimuths, self._cells, self._cell_m = azimuths, cells, cell_m
        self._physics, self._weather = physics, weather
        ranges_m: Array = (np.arange(cells, dtype=np.float64) + 0.5) * cell_m
        self._falling = (_REFERENCE_M / np.maximum(ranges_m, 2.0)) ** physics.fall_exponent * weather.left(ranges_m)
        self._falling *= ratio(physics.returns_db)
        self._ground = ratio(physics.ground_db) * (_REFERENCE_M / np.maximum(ranges_m, 4.0)) ** physics.ground_exponent
        self._ground *= -np.expm1(-((ranges_m / physics.ground_start_m) ** 2)) * weather.left(ranges_m)
        self._ground[ranges_m < _VEHICLE_M] = ratio(physics.vehicle_db)
        self._air = weather.backscatter(ranges_m)

    def power(self, near: Reflectors, poses: Array) -> tuple[Image, Image]:
        """Two (A, C) images from (A, 3) poses: walls and scatterers, which the beam spreads, and ground and air."""
        hits = cast_rays(near, poses, self._cells * self._cell_m, self._physics.occlusion)
        returns = [self._walls(hits, near, poses), self._scatterers(hits, near, poses)]
        returns.append(self._echoes(hits, returns[0], poses))
        returns.append(self._laps(hits, returns[0]))
        returns.append(self._mirrored(hits, near, poses, returns))
        rows, range_m, powers = (np.concatenate(parts) for parts in zip(*returns, strict=True))
        return self._gathered(rows, range_m, powers), self._diffuse(hits, poses)

    def _walls(self, hits: Hits, near: Reflectors, poses: Array) -> tuple[Rows, Array, Array]:
        physics, cosine = self._physics, hits.cosine
        slant = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        floor = ratio(physics.diffuse_floor_db)
        shape = floor + (1.0 - floor) * cosine**physics.incidence_exponent
        shape += ratio(physics.specular_db) * np.exp(-0.5 * (slant / physics.specular_width_rad) ** 2)
        x, y = self._points(hits.rows, hits.range_m, poses).T
        powers = near.wall_powers[hits.walls] * shape * hits.left * self._lumps(x, y)
        # A wall that is met aslant is met at a different range at either edge of the azimuth.
        row_rad = 2.0 * np.pi / self._azimuths
        reach_m = np.minimum(hits.range_m * row_rad * slant / np.maximum(cosine, 0.02), 4.0) / 3.0
        range_m = (hits.range_m[:, None] + reach_m[:, None] * np.array([-1.0, 0.0, 1.0])).ravel()
        return np.repeat(hits.rows, 3), range_m, np.repeat(powers / 3.0, 3)

    def _echoes(self, hits: Hits, walls: tuple[Rows, Array, Array], poses: Array) -> tuple[Rows, Array, Array]:
        """Late returns of each wall at distances behind it that stay the same in the world."""
        x, y = self._points(hits.rows, hits.range_m, poses).T
        powers = walls[2][::3] * (3.0 * ratio(self._physics.echo_db) / _ECHOES)
        late_m = [-self._physics.echo_m * np.log(self._uniform(x, y, salt)) for salt in range(1, _ECHOES + 1)]
        range_m = np.concatenate([hits.range_m + late for late in late_m])
        return np.tile(hits.rows, _ECHOES), range_m, np.tile(powers, _ECHOES)

    def _scatterers(self, hits: Hits, near: Reflectors, poses: Array) -> tuple[Rows, Array, Array]:
        """Each scatterer returns on the azimuth that points at it when the radar looks there."""
        rows, range_m = _seen_from(poses, near.scatterers_m)
        return rows, range_m, near.scatterer_powers * hits.left_at(rows, range_m)

    def _laps(self, hits: Hits, walls: tuple[Rows, Array, Array]) -> tuple[Rows, Array, Array]:
        facing = np.repeat(hits.cosine > _FACE_ON, 3)
        rows, range_m, powers = (part[facing] for part in walls)
        ghost = ratio(self._physics.ghost_db)
        again = powers * ghost, powers * ghost**2
        return np.tile(rows, 2), np.concatenate([2.0 * range_m, 3.0 * range_m]), np.concatenate(again)

    def _mirrored(
        self, hits: Hits, near: Reflectors, poses: Array, returns: list[tuple[Rows, Array, Array]]
    ) -> tuple[Rows, Array, Array]:
        """Copies of walls and scatterers behind the wall that returns most, where its ends frame them."""
        if not len(hits.walls):
            return np.empty(0, np.intp), np.empty(0), np.empty(0)
        strength = np.bincount(hits.walls, hits.cosine * hits.left / np.maximum(hits.range_m, 2.0))
        mirror = int(np.argmax(strength))
        start, end = near.walls_m[mirror]
        along = (end - start) / np.hypot(*(end - start))
        normal = np.array([-along[1], along[0]])
        rows, range_m, powers = (np.concatenate(parts) for parts in zip(*returns[:2], strict=True))
        points = self._points(rows, range_m, poses)
        rows, range_m = _seen_from(poses, points - 2.0 * ((points - start) @ normal)[:, None] * normal)
        wall_m = np.full(self._azimuths, np.inf)
        of_mirror = hits.walls == mirror
        wall_m[hits.rows[of_mirror]] = hits.range_m[of_mirror]
        left = np.ones(self._azimuths)
        left[hits.rows[of_mirror]] = hits.left[of_mirror]
        framed = range_m > wall_m[rows] + 1.0
        return rows[framed], range_m[framed], (powers * left[rows])[framed] * ratio(self._physics.ghost_db)

    def _points(self, rows: Rows, range_m: Array, poses: Array) -> Array:
        angle = poses[:, 2] - np.arange(self._azimuths) * (2.0 * np.pi / self._azimuths)
        x = poses[rows, 0] + range_m * np.cos(angle)[rows]
        return np.stack([x, poses[rows, 1] + range_m * np.sin(angle)[rows]], axis=1)

    def _lumps(self, x: Array, y: Array) -> Array:
        """Mean 1, alike within squares of the world, so that a wall's bright spots stay where they are."""
        exponent = self._physics.lump_exponent
        drawn = (-np.log(self._uniform(x, y, 0))) ** exponent
        return np.asarray(drawn / math.gamma(1.0 + exponent))

    def _uniform(self, x: Array, y: Array, salt: int) -> Array:
        """(N,) numbers between 0 and 1, the same within each square of `lump_m` of the world; a hash, not a draw."""
        column, row = (np.floor(v / self._physics.lump_m).astype(np.int64).astype(np.uint64) for v in (x, y))
        mixed = (column * np.uint64(0x9E3779B97F4A7C15)) ^ (row * np.uint64(0xC2B2AE3D27D4EB4F))
        mixed = (mixed ^ (mixed >> np.uint64(29)) ^ np.uint64(salt)) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(32))) * np.uint64(0x94D049BB133111EB)
        return np.asarray(((mixed >> np.uint64(40)).astype(np.float64) + 0.5) / 2.0**24)

    def _gathered(self, rows: Rows, range_m: Array, powers: Array) -> Image:
        cells = (range_m / self._cell_m).astype(np.intp)
        inside = (cells >= 0) & (cells < self._cells)
        cells = cells[inside]
        flat = rows[inside] * self._cells + cells
        image = np.bincount(flat, powers[inside] * self._falling[cells], self._azimuths * self._cells)
        return image.reshape(self._azimuths, self._cells).astype(np.float32)

    def _diffuse(self, hits: Hits, poses: Array) -> Image:
        """Ground, shadowed by walls, and drops in the air."""
        rows = np.arange(0, self._azimuths, _COARSER[0])
        columns = np.arange(0, self._cells, _COARSER[1])
        range_m = (columns + _COARSER[1] / 2) * self._cell_m
        angle = poses[rows, 2] - rows * (2.0 * np.pi / self._azimuths)
        x = poses[rows, 0, None] + range_m * np.cos(angle)[:, None]
        y = poses[rows, 1, None] + range_m * np.sin(angle)[:, None]
        texture = _patches()
        column, row = (np.mod(v / _PATCH_M, len(texture)).astype(np.float32) for v in (x, y))
        patches = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        spread = 0.23 * self._physics.ground_patch_db
        patches = np.exp(np.float32(spread) * patches - np.float32(spread**2 / 2))
        fronts_m, behind = hits.fronts_m[rows], hits.left_behind[rows].astype(np.float32)
        for depth in range(int(np.isfinite(fronts_m).any(axis=0).sum())):
            lost = behind[:, depth] - behind[:, depth + 1]
            patches -= np.where(range_m >= fronts_m[:, depth, None], lost[:, None], 0.0) * patches
        size = (self._cells, self._azimuths)
        fine = np.asarray(cv2.resize(np.ascontiguousarray(patches), size, interpolation=cv2.INTER_LINEAR), np.float32)
        return np.asarray(fine * self._ground.astype(np.float32) + self._air.astype(np.float32), np.float32)


@functools.lru_cache(maxsize=1)
def _patches() -> Image:
    """(512, 512) float32 of mean 0 and standard deviation 1, periodic: what the ground is like."""
    white = np.random.default_rng(20).standard_normal((512, 512)).astype(np.float32)
    tiled = np.pad(white, 64, mode='wrap')
    total = np.zeros_like(white)
    for sigma, weight in ((1.0, 1.0), (8.0, 1.0)):
        smooth = cv2.GaussianBlur(tiled, (0, 0), sigma)[64:-64, 64:-64]
        total += np.float32(weight) * smooth / smooth.std()
    return np.asarray(total / total.std(), np.float32)


def _seen_from(poses: Array, points_m: Array) -> tuple[Rows, Array]:
    """(S,) row that looks at each of (S, 2) points, and the range from where the radar then is."""
    middle = np.broadcast_to(poses[len(poses) // 2], (len(points_m), 3))
    rows, _ = _looked_at(middle, points_m, len(poses))
    return _looked_at(poses[rows], points_m, len(poses))


def _looked_at(poses: Array, points_m: Array, azimuths: int) -> tuple[Rows, Array]:
    offset = points_m - poses[:, :2]
    clockwise = poses[:, 2] - np.arctan2(offset[:, 1], offset[:, 0])
    rows = np.rint(clockwise / (2.0 * np.pi) * azimuths).astype(np.intp) % azimuths
    return rows, np.hypot(offset[:, 0], offset[:, 1])
