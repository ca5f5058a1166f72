"""How well a scan agrees with other places at which the vehicle would be elsewhere."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import Alignment, Candidate, Pose

APART_M, APART_RAD = 2.0, math.radians(3.0)
"""Two alignments of one scan say the same if they put the vehicle nearer to one another than this."""


def scores_elsewhere(candidates: Sequence[Candidate]) -> NDArray[np.float64]:
    """(k,) for each candidate, the best score of the alignments with others by which the vehicle would be elsewhere.

    0 where there is none, or none whose score is above 0. Scans agree a little with any place. Where one agrees about
    as well at a pose elsewhere, the agreement says nothing; the places around the right one say the same as it does.
    """
    best = np.zeros(len(candidates))
    for (row, one), (other_row, other) in itertools.combinations(enumerate(candidates), 2):
        if one.alignment and other.alignment and _is_elsewhere(one.pose, one.alignment, other.pose, other.alignment):
            best[row] = max(best[row], other.alignment.score)
            best[other_row] = max(best[other_row], one.alignment.score)
    return best


def _is_elsewhere(place: Pose, found: Alignment, other_place: Pose, other: Alignment) -> bool:
    apart_m = math.hypot(place.x_m - other_place.x_m, place.y_m - other_place.y_m)
    if math.isnan(place.yaw_rad) or math.isnan(other_place.yaw_rad):
        # The vehicle is somewhere around each place.
        return apart_m > float(np.hypot(*found.pose[:2]) + np.hypot(*other.pose[:2])) + APART_M
    x_m, y_m, yaw_rad = _in_map(place, found)
    other_x_m, other_y_m, other_yaw_rad = _in_map(other_place, other)
    turned_rad = abs(math.remainder(yaw_rad - other_yaw_rad, 2.0 * math.pi))
    return math.hypot(x_m - other_x_m, y_m - other_y_m) > APART_M or turned_rad > APART_RAD


def _in_map(place: Pose, found: Alignment) -> tuple[float, float, float]:
    forward_m, left_m, turned_rad = found.pose.tolist()
    cos, sin = math.cos(place.yaw_rad), math.sin(place.yaw_rad)
    return (
        place.x_m + cos * forward_m - sin * left_m,
        place.y_m + sin * forward_m + cos * left_m,
        place.yaw_rad + turned_rad,
    )
