"""A recorded drive as a path through a world."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.simulation.route import Route
from offradar_ros.recordings.datasets.positions import read_tum

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, eq=False)
class RecordedPath:
    """Poses of a vehicle over time. It may stand still; before the first and after the last pose it does.

    Attributes:
        seconds: (N,) float64 since the first pose, increasing.
        poses: (N, 3) float64, x and y in metres of the world, heading in radians without jumps.
    """

    seconds: Array
    poses: Array

    @property
    def duration_s(self) -> float:
        """Time from the first pose to the last."""
        return float(self.seconds[-1])

    @functools.cached_property
    def driven_m(self) -> Array:
        """(N,) metres driven up to each pose."""
        steps = np.diff(self.poses[:, :2], axis=0)
        return np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])

    def scans(self, rotation_s: float = 0.25, start_m: float = 0.0) -> int:
        """Number of whole rotations between `start_m` and the end."""
        return int((self.duration_s - self.seconds_at(start_m)) / rotation_s)

    def seconds_at(self, driven_m: float) -> float:
        """Time at which `driven_m` metres are first driven."""
        after = int(np.searchsorted(self.driven_m, driven_m))
        return float(np.interp(driven_m, self.driven_m[: after + 1], self.seconds[: after + 1]))

    def at(self, seconds: Array) -> Array:
        """(M, 3) poses at (M,) seconds, interpolated linearly."""
        return np.column_stack([np.interp(seconds, self.seconds, column) for column in self.poses.T])

    def route(self) -> Route:
        """The line of the path, for traffic."""
        apart = np.unique(np.floor(self.driven_m / 2.0), return_index=True)[1]
        points = self.poses[apart, :2]
        if len(points) < 2:
            points = self.poses[0, :2] + np.array([(0.0, 0.0), (1.0, 0.0)])
        return Route(points, closed=False, corner_length_m=4)


def load_tum(path: str | Path) -> RecordedPath:
    """The path of a TUM file (lines of ``seconds x y z qx qy qz qw``), without z, roll and pitch.

    DataError for a damaged file and for one of a single pose.
    """
    trajectory = read_tum(Path(path))
    if len(trajectory) < 2:
        raise DataError(f'{path}: expected a drive of at least two poses, got one')
    seconds = (trajectory.stamps_ns - trajectory.stamps_ns[0]) / 1e9
    return RecordedPath(seconds, np.column_stack([trajectory.positions[:, :2], np.unwrap(trajectory.yaws_rad)]))
