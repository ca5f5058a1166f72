"""A sequence's scans on the ground, and their distance to the route of another sequence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import LocalFrame

NEAR_M = 25.0
_STEP_M = 5.0
_MOST_SCANS = 1000
_CHUNK = 500


class Route(NamedTuple):
    """A route in an east-north-up frame, metres, with altitudes of 0, so that data sets' heights may disagree.

    Attributes:
        scans: (N, 3) float64 positions of scans, at most 1000, evenly spread.
        line: (M, 3) float64 positions of scans that are 5 m or more apart.
    """

    scans: NDArray[np.float64]
    line: NDArray[np.float64]


def route(points_lla: NDArray[np.float64], frame: LocalFrame) -> Route:
    """The route of (N, 3) latitude°, longitude°, altitude m in the order of time; all finite, N > 0."""
    # The third coordinate keeps the curvature of the Earth: with it, distances are right over any range.
    points_m = frame.to_enu(points_lla * (1.0, 1.0, 0.0))
    kept = [points_m[0]]
    for point in points_m:
        if np.linalg.norm(point - kept[-1]) >= _STEP_M:
            kept.append(point)
    spread = np.linspace(0, len(points_m) - 1, min(len(points_m), _MOST_SCANS)).round().astype(np.intp)
    return Route(points_m[spread], np.array(kept))


def nearest(points_m: NDArray[np.float64], line_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """(N,) distance in metres from each point to the nearest point of a line, and (N,) the index of that point."""
    away_m = np.empty(len(points_m))
    which = np.empty(len(points_m), np.intp)
    for start in range(0, len(points_m), _CHUNK):
        part = slice(start, start + _CHUNK)
        squared = sum(np.subtract.outer(points_m[part, axis], line_m[:, axis]) ** 2 for axis in range(line_m.shape[1]))
        which[part] = np.argmin(squared, axis=1)
        away_m[part] = np.sqrt(np.min(squared, axis=1))
    return away_m, which


def share_near(points_m: NDArray[np.float64], line_m: NDArray[np.float64], near_m: float = NEAR_M) -> float:
    """Share of the points that are within `near_m` of a line, 0 to 1."""
    return float(np.mean(nearest(points_m, line_m)[0] <= near_m))
