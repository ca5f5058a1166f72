"""Where the ray of each azimuth hits walls.

Convention: row k points k/A of a turn clockwise from the heading of the radar's k-th pose; headings are
counter-clockwise from east.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from offradar_ros.lab.simulation.reflectors import Reflectors

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

DEPTH = 6
"""Maximum number of walls that a ray hits."""


@dataclasses.dataclass(frozen=True, eq=False)
class Hits:
    """H hits of rays on walls, by A azimuths.

    Attributes:
        rows: (H,) azimuth of the ray.
        walls: (H,) index of the wall.
        range_m: (H,) float64.
        cosine: (H,) float64, cosine of the angle between the ray and the wall's normal, 0 to 1.
        transmission: (H,) float64, two-way transmission of the walls in front.
        wall_ranges_m: (A, DEPTH) float64, ranges of the walls that each ray hits, nearest first; infinite for none.
        transmission_behind: (A, DEPTH + 1) float64, two-way transmission of the first 0, 1, … of them.
    """

    rows: Rows
    walls: Rows
    range_m: Array
    cosine: Array
    transmission: Array
    wall_ranges_m: Array
    transmission_behind: Array

    def transmission_at(self, rows: Rows, range_m: Array) -> Array:
        """(N,) two-way transmission of the walls in front of (N,) ranges on the rays of (N,) rows."""
        passed = np.sum(self.wall_ranges_m[rows] < range_m[:, None], axis=1)
        return np.asarray(self.transmission_behind[rows, passed])


def cast_rays(reflectors: Reflectors, poses: Array, max_range_m: float, occlusion: float = 1.0) -> Hits:
    """The walls that each ray hits, up to `DEPTH`; `poses` is (A, 3) x, y, heading, one for each azimuth.

    `occlusion` is the exponent of each wall's `wall_transmission`.
    """
    azimuths = len(poses)
    rows, walls = _candidates(reflectors.walls_m, poses)
    origins_m = poses[:, :2] - poses[azimuths // 2, :2]
    starts_m = reflectors.walls_m[:, 0] - poses[azimuths // 2, :2]
    along_m = reflectors.walls_m[:, 1] - reflectors.walls_m[:, 0]
    angle = poses[:, 2] - np.arange(azimuths) * (2.0 * np.pi / azimuths)
    ray_x, ray_y = np.cos(angle)[rows], np.sin(angle)[rows]
    along_x, along_y = along_m[walls].T
    from_x, from_y = (starts_m[walls] - origins_m[rows]).T
    across = ray_x * along_y - ray_y * along_x
    with np.errstate(divide='ignore', invalid='ignore'):
        range_m = (from_x * along_y - from_y * along_x) / across
        fraction = (from_x * ray_y - from_y * ray_x) / across
    hit = (range_m > 0.5) & (range_m < max_range_m) & (fraction >= 0.0) & (fraction <= 1.0)
    rows, walls, range_m, across = rows[hit], walls[hit], range_m[hit], across[hit]
    order = np.argsort(rows + range_m / (max_range_m + 1.0))
    rows, walls, range_m, across = rows[order], walls[order], range_m[order], across[order]
    in_front = np.arange(len(rows)) - np.searchsorted(rows, rows)
    kept = in_front < DEPTH
    rows, walls, range_m, across, in_front = rows[kept], walls[kept], range_m[kept], across[kept], in_front[kept]
    wall_ranges_m = np.full((azimuths, DEPTH), np.inf)
    wall_ranges_m[rows, in_front] = range_m
    transmission_behind = np.ones((azimuths, DEPTH + 1))
    transmission_behind[rows, in_front + 1] = reflectors.wall_transmission[walls] ** occlusion
    np.cumprod(transmission_behind, axis=1, out=transmission_behind)
    cosine = np.abs(across) / np.hypot(along_m[walls, 0], along_m[walls, 1])
    return Hits(rows, walls, range_m, cosine, transmission_behind[rows, in_front], wall_ranges_m, transmission_behind)


def _candidates(walls_m: Array, poses: Array) -> tuple[Rows, Rows]:
    """Rows and walls that may meet: those between the bearings of its ends, with a margin for the radar's motion."""
    azimuths = len(poses)
    middle = poses[azimuths // 2]
    starts, ends = walls_m[:, 0] - middle[:2], walls_m[:, 1] - middle[:2]
    along = ends - starts
    nearest = np.clip(-np.sum(starts * along, axis=1) / np.maximum(np.sum(along**2, axis=1), 1e-12), 0.0, 1.0)
    distance_m = np.hypot(*(starts + nearest[:, None] * along).T)
    moved_m = float(np.hypot(*(poses[:, :2] - middle[:2]).T).max())
    turned = float(np.abs(np.angle(np.exp(1j * (poses[:, 2] - middle[2])))).max())
    rows_a_radian = azimuths / (2.0 * np.pi)
    first, last = (rows_a_radian * (middle[2] - np.arctan2(ends_[:, 1], ends_[:, 0])) for ends_ in (starts, ends))
    width = np.mod(last - first + azimuths / 2, azimuths) - azimuths / 2
    shift = np.arcsin(np.minimum(1.0, moved_m / np.maximum(distance_m, 1e-9)))
    margin = rows_a_radian * (shift + turned) + 1.0
    # A wall that the radar may reach is a candidate on every row.
    margin[distance_m <= moved_m + 0.5] = azimuths
    begin = np.floor(first + np.minimum(width, 0.0) - margin).astype(np.intp)
    count = np.minimum(np.ceil(np.abs(width) + 2.0 * margin).astype(np.intp) + 2, azimuths)
    walls = np.repeat(np.arange(len(walls_m)), count)
    within = np.arange(len(walls)) - np.repeat(np.cumsum(count) - count, count)
    return (begin[walls] + within) % azimuths, walls
