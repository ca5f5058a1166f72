"""Power of all returns before the beam and the receiver: one value for each azimuth and range cell.

The return of a wall depends on the angle of incidence, varies along the wall, and the wall occludes what is behind it;
scatterers (poles, trees, cars) return equally in all directions; all returns fall with range. Walls also cause late
returns. Multipath adds ghosts: returns at two and three times their range, from further round trips between the vehicle
and a wall at normal incidence, and mirror images behind the walls with the strongest returns. Every return leaves a
tail behind it. What the ground returns is in `terrain`.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.physics import RadarPhysics, linear_power
from offradar_ros.lab.simulation.rays import Hits, Rows, cast_rays
from offradar_ros.lab.simulation.reflectors import Reflectors
from offradar_ros.lab.simulation.terrain import Terrain
from offradar_ros.lab.simulation.weather import Weather

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_REFERENCE_M = 10.0
"""Range for which the powers of a world are given."""

_VEHICLE_M = 2.4
"""The radar's own vehicle returns at shorter ranges than this."""

_NORMAL_INCIDENCE = 0.995
"""Cosine of incidence above which the signal goes back and forth between a wall and the vehicle."""

_ECHOES = 3
_TAIL_STEP = 4
"""Tails are computed for every fourth cell."""


class Scene:
    """Adds up returns for scans of `azimuths` × `cells` of `cell_m` metres."""

    def __init__(
        self, azimuths: int, cells: int, cell_m: float, physics: RadarPhysics, weather: Weather, ground_seed: int
    ) -> None:
        self._azimuths, self._cells, self._cell_m = azimuths, cells, cell_m
        self._physics, self._weather = physics, weather
        ranges_m: Array = (np.arange(cells, dtype=np.float64) + 0.5) * cell_m
        self._range_gain = (_REFERENCE_M / np.maximum(ranges_m, 2.0)) ** physics.range_exponent * weather.transmission(
            ranges_m
        )
        self._range_gain *= linear_power(physics.returns_db)
        ground: Array = (
            linear_power(physics.ground_db) * (_REFERENCE_M / np.maximum(ranges_m, 4.0)) ** physics.ground_exponent
        )
        ground *= -np.expm1(-((ranges_m / physics.ground_start_m) ** 2)) * weather.transmission(ranges_m)
        ground[ranges_m < _VEHICLE_M] = linear_power(physics.vehicle_db)
        self._ground: Image = ground.astype(np.float32)
        self._air: Image = weather.backscatter(ranges_m).astype(np.float32)
        self._tails = _tails(-(-cells // _TAIL_STEP), _TAIL_STEP * cell_m, physics)
        self._terrain = Terrain(azimuths, cells, cell_m, physics, ground_seed)

    def power(self, near: Reflectors, poses: Array) -> tuple[Image, Image]:
        """Two (A, C) images from (A, 3) poses: walls and scatterers, to which the beam is applied; ground and air."""
        hits = cast_rays(near, poses, self._cells * self._cell_m, self._physics.occlusion)
        returns = [self._walls(hits, near, poses), self._scatterers(hits, near, poses)]
        returns.append(self._echoes(hits, returns[0], poses))
        returns.append(self._round_trips(hits, returns[0]))
        returns.append(self._mirror_images(hits, near, poses, returns))
        rows, range_m, powers = (np.concatenate(parts) for parts in zip(*returns, strict=True))
        diffuse = self._terrain.power(hits, poses) * self._ground + self._air
        return self._with_tails(self._accumulated(rows, range_m, powers)), diffuse

    def _walls(self, hits: Hits, near: Reflectors, poses: Array) -> tuple[Rows, Array, Array]:
        physics, cosine = self._physics, hits.cosine
        slant = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        floor = linear_power(physics.diffuse_floor_db)
        shape = floor + (1.0 - floor) * cosine**physics.incidence_exponent
        shape += linear_power(physics.specular_db) * np.exp(-0.5 * (slant / physics.specular_width_rad) ** 2)
        x, y = self._points(hits.rows, hits.range_m, poses).T
        powers = near.wall_powers[hits.walls] * shape * hits.transmission * self._texture(x, y)
        # The range of an oblique wall differs between the two edges of the azimuth.
        row_rad = 2.0 * np.pi / self._azimuths
        reach_m = np.minimum(hits.range_m * row_rad * slant / np.maximum(cosine, 0.02), 4.0) / 3.0
        range_m = (hits.range_m[:, None] + reach_m[:, None] * np.array([-1.0, 0.0, 1.0])).ravel()
        return np.repeat(hits.rows, 3), range_m, np.repeat(powers / 3.0, 3)

    def _echoes(self, hits: Hits, walls: tuple[Rows, Array, Array], poses: Array) -> tuple[Rows, Array, Array]:
        """Late returns of each wall, at distances behind it that are fixed in the world."""
        x, y = self._points(hits.rows, hits.range_m, poses).T
        powers = walls[2][::3] * (3.0 * linear_power(self._physics.echo_db) / _ECHOES)
        late_m = [-self._physics.echo_m * np.log(self._uniform(x, y, salt)) for salt in range(1, _ECHOES + 1)]
        range_m = np.concatenate([hits.range_m + late for late in late_m])
        return np.tile(hits.rows, _ECHOES), range_m, np.tile(powers, _ECHOES)

    def _scatterers(self, hits: Hits, near: Reflectors, poses: Array) -> tuple[Rows, Array, Array]:
        """Each scatterer returns on the azimuth at which the moving radar points at it."""
        rows, range_m = _rows_and_ranges(poses, near.scatterers_m)
        return rows, range_m, near.scatterer_powers * hits.transmission_at(rows, range_m)

    def _round_trips(self, hits: Hits, walls: tuple[Rows, Array, Array]) -> tuple[Rows, Array, Array]:
        normal = np.repeat(hits.cosine > _NORMAL_INCIDENCE, 3)
        rows, range_m, powers = (part[normal] for part in walls)
        ghost = linear_power(self._physics.ghost_db)
        ghosts = powers * ghost, powers * ghost**2
        return np.tile(rows, 2), np.concatenate([2.0 * range_m, 3.0 * range_m]), np.concatenate(ghosts)

    def _mirror_images(
        self, hits: Hits, near: Reflectors, poses: Array, returns: list[tuple[Rows, Array, Array]]
    ) -> tuple[Rows, Array, Array]:
        """Mirror images of walls and scatterers behind the walls with the strongest returns, within their ends."""
        rows, range_m, powers = (np.concatenate(parts) for parts in zip(*returns[:2], strict=True))
        strength = np.bincount(hits.walls, hits.cosine * hits.transmission / np.maximum(hits.range_m, 2.0))
        mirrors = np.argsort(-strength, kind='stable')[: self._physics.ghost_walls]
        points = self._points(rows, range_m, poses)
        images = [
            self._mirror_image(int(mirror), hits, near, poses, points, powers)
            for mirror in mirrors
            if strength[mirror] > 0
        ]
        empty = np.empty(0, np.intp), np.empty(0), np.empty(0)
        found = [np.concatenate(parts) for parts in zip(empty, *images, strict=True)]
        return found[0], found[1], found[2]

    def _mirror_image(
        self, mirror: int, hits: Hits, near: Reflectors, poses: Array, points: Array, powers: Array
    ) -> tuple[Rows, Array, Array]:
        start, end = near.walls_m[mirror]
        along = (end - start) / np.hypot(*(end - start))
        normal = np.array([-along[1], along[0]])
        rows, range_m = _rows_and_ranges(poses, points - 2.0 * ((points - start) @ normal)[:, None] * normal)
        wall_m = np.full(self._azimuths, np.inf)
        on_mirror = hits.walls == mirror
        wall_m[hits.rows[on_mirror]] = hits.range_m[on_mirror]
        transmission = np.ones(self._azimuths)
        transmission[hits.rows[on_mirror]] = hits.transmission[on_mirror]
        visible = range_m > wall_m[rows] + 1.0
        return (
            rows[visible],
            range_m[visible],
            (powers * transmission[rows])[visible] * linear_power(self._physics.ghost_db),
        )

    def _points(self, rows: Rows, range_m: Array, poses: Array) -> Array:
        angle = poses[:, 2] - np.arange(self._azimuths) * (2.0 * np.pi / self._azimuths)
        x = poses[rows, 0] + range_m * np.cos(angle)[rows]
        return np.stack([x, poses[rows, 1] + range_m * np.sin(angle)[rows]], axis=1)

    def _texture(self, x: Array, y: Array) -> Array:
        """(N,) factors of mean 1, constant within squares of the world: bright parts of a wall do not move."""
        exponent = self._physics.texture_exponent
        drawn = (-np.log(self._uniform(x, y, 0))) ** exponent
        return np.asarray(drawn / math.gamma(1.0 + exponent))

    def _uniform(self, x: Array, y: Array, salt: int) -> Array:
        """(N,) numbers between 0 and 1, constant within squares of `texture_m` in the world: a hash of the square."""
        column, row = (np.floor(v / self._physics.texture_m).astype(np.int64).astype(np.uint64) for v in (x, y))
        mixed = (column * np.uint64(0x9E3779B97F4A7C15)) ^ (row * np.uint64(0xC2B2AE3D27D4EB4F))
        mixed = (mixed ^ (mixed >> np.uint64(29)) ^ np.uint64(salt)) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(32))) * np.uint64(0x94D049BB133111EB)
        return np.asarray(((mixed >> np.uint64(40)).astype(np.float64) + 0.5) / 2.0**24)

    def _accumulated(self, rows: Rows, range_m: Array, powers: Array) -> Image:
        cells = (range_m / self._cell_m).astype(np.intp)
        inside = (cells >= 0) & (cells < self._cells)
        cells = cells[inside]
        flat = rows[inside] * self._cells + cells
        image = np.bincount(flat, powers[inside] * self._range_gain[cells], self._azimuths * self._cells)
        return image.reshape(self._azimuths, self._cells).astype(np.float32)

    def _with_tails(self, power: Image) -> Image:
        """Every return leaves an exponential tail behind it."""
        padded = np.pad(power, ((0, 0), (0, -self._cells % _TAIL_STEP)))
        summed = padded.reshape(self._azimuths, -1, _TAIL_STEP).sum(axis=2)
        size = (padded.shape[1], self._azimuths)
        fine = cv2.resize(summed @ self._tails, size, interpolation=cv2.INTER_LINEAR)
        return np.asarray(power + fine[:, : self._cells], np.float32)


def _tails(steps: int, step_m: float, physics: RadarPhysics) -> Image:
    """(S, S) level at step j of the tail of a return of power 1 at step i, on its diagonal and below it 0."""
    behind = np.arange(steps) - np.arange(steps)[:, None]
    levels = linear_power(physics.tail_db) * np.exp(-np.maximum(behind - 1, 0) * step_m / physics.tail_m)
    return np.asarray(np.where(behind > 0, levels, 0.0), np.float32)


def _rows_and_ranges(poses: Array, points_m: Array) -> tuple[Rows, Array]:
    """(S,) row that points at each of (S, 2) points, and (S,) range from the radar's pose at that row."""
    middle = np.broadcast_to(poses[len(poses) // 2], (len(points_m), 3))
    rows, _ = _rows_and_ranges_from(middle, points_m, len(poses))
    return _rows_and_ranges_from(poses[rows], points_m, len(poses))


def _rows_and_ranges_from(poses: Array, points_m: Array, azimuths: int) -> tuple[Rows, Array]:
    offset = points_m - poses[:, :2]
    clockwise = poses[:, 2] - np.arctan2(offset[:, 1], offset[:, 0])
    rows = np.rint(clockwise / (2.0 * np.pi) * azimuths).astype(np.intp) % azimuths
    return rows, np.hypot(offset[:, 0], offset[:, 1])
