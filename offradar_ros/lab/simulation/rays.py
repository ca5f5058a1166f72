"""Where each azimuth's ray meets walls.

Convention: row k looks k/A of a turn clockwise from the heading of the radar's k-th pose; headings are
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
"""A ray is followed through this many walls."""


@dataclasses.dataclass(frozen=True, eq=False)
class Hits:
    """H meetings of rays and walls.

    Attributes:
        rows: (H,) which ray.
        walls: (H,) which wall.
        range_m: (H,) float64.
        cosine: (H,) float64 of the angle between the ray and the wall's normal, 0 to 1.
        left: (H,) float64 share of the power, there and back, that the walls in front leave.
        fronts_m: (A, DEPTH) float64 ranges of the walls that each ray meets, nearest first; infinite where none.
        left_behind: (A, DEPTH + 1) float64 share of the power that is left after 0, 1, … of them.
    """

    rows: Rows
    walls: Rows
    range_m: Array
    cosine: Array
    left: Array
    fronts_m: Array
    left_behind: Array

    def left_at(self, rows: Rows, range_m: Array) -> Array:
        """(N,) share of the power that walls leave at (N,) ranges on the rays of (N,) rows."""
        passed = np.sum(self.fronts_m[rows] < range_m[:, None], axis=1)
        return np.asarray(self.left_behind[rows, passed])


def cast_rays(reflectors: Reflectors, poses: Array, max_range_m: float, occlusion: float = 1.0) -> Hits:
    """Every wall that a ray meets, up to `DEPTH` a ray; `poses` is (A, 3) x, y, heading, one for each azimuth.

    `occlusion` is the power to which each wall's `wall_through` is raised.
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
    met = (range_m > 0.5) & (range_m < max_range_m) & (fraction >= 0.0) & (fraction <= 1.0)
    rows, walls, range_m, across = rows[met], walls[met], range_m[met], across[met]
    order = np.argsort(rows + range_m / (max_range_m + 1.0))
    rows, walls, range_m, across = rows[order], walls[order], range_m[order], across[order]
    passed = np.arange(len(rows)) - np.searchsorted(rows, rows)
    seen = passed < DEPTH
    rows, walls, range_m, across, passed = rows[seen], walls[seen], range_m[seen], across[seen], passed[seen]
    fronts_m = np.full((azimuths, DEPTH), np.inf)
    fronts_m[rows, passed] = range_m
    left_behind = np.ones((azimuths, DEPTH + 1))
    left_behind[rows, passed + 1] = reflectors.wall_through[walls] ** occlusion
    np.cumprod(left_behind, axis=1, out=left_behind)
    cosine = np.abs(across) / np.hypot(along_m[walls, 0], along_m[walls, 1])
    return Hits(rows, walls, range_m, cosine, left_behind[rows, passed], fronts_m, left_behind)


def _candidates(walls_m: Array, poses: Array) -> tuple[Rows, Rows]:
    """Rows and walls that may meet: rows between the bearings of a wall's ends, and as many more as the radar moves."""
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
    # A wall that the radar may drive up to is tried on every row.
    margin[distance_m <= moved_m + 0.5] = azimuths
    begin = np.floor(first + np.minimum(width, 0.0) - margin).astype(np.intp)
    count = np.minimum(np.ceil(np.abs(width) + 2.0 * margin).astype(np.intp) + 2, azimuths)
    walls = np.repeat(np.arange(len(walls_m)), count)
    within = np.arange(len(walls)) - np.repeat(np.cumsum(count) - count, count)
    return (begin[walls] + within) % azimuths, walls
