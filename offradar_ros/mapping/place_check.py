"""What makes a place unusable, whether it comes in a message, from a file or from a merge."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offradar_ros.positions.rules import END_NS
from offradar_ros.types import PlaceTable

MAX_COORDINATE_M = 1e8
"""No position on Earth has a larger coordinate, whatever the origin of the frame."""

MAX_YAW_RAD = 1e6
"""A heading may be counted on over the turns of a drive, as paths have it."""

MAX_PLACE_ID = 2**32 - 1
MAX_SESSION_ID = 2**31 - 1

MAX_MEAN_VALUE = 2.0**116
"""Largest absolute value of a mean: the distance of two such means, of any dimension, is a finite float32."""


def place_problem(table: PlaceTable) -> str | None:
    """Why a table holds a place that can neither be stored nor be searched, in one line; None if all are valid.

    Allocates a number or two for each place, not for each value of the means.
    """
    for problem, valid in (
        (f'an id outside 0 to {MAX_PLACE_ID}', _within(table.place_ids, 0, MAX_PLACE_ID)),
        (f'a session id outside 0 to {MAX_SESSION_ID}', _within(table.session_ids, 0, MAX_SESSION_ID)),
        (f'a stamp outside 0 to {END_NS} ns', _within(table.stamps_ns, 0, END_NS - 1)),
        (f'a position outside ±{MAX_COORDINATE_M:g} m', valid_positions(table.positions_m)),
        (f'a heading outside ±{MAX_YAW_RAD:g} rad', np.isnan(table.yaws_rad) | (np.abs(table.yaws_rad) <= MAX_YAW_RAD)),
        ('a heading whose standard deviation is outside 0 to π', _possible_sds(table.yaw_sds_rad)),
        ('a U that is not finite or below 0', _within(table.uncertainties, 0.0, float(np.finfo(np.float32).max))),
        (f'a mean that is not finite or beyond ±{MAX_MEAN_VALUE:g}', valid_means(table.means)),
    ):
        if not valid.all():
            return f'place {int(table.place_ids[int(np.argmin(valid))])} has {problem}'
    return None


def _possible_sds(sds_rad: NDArray[np.float32]) -> NDArray[np.bool_]:
    return np.asarray(np.isnan(sds_rad) | _within(sds_rad, 0.0, float(np.float32(math.pi))))


def valid_means(means: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,) whether each of (N, d) means has finite values only, none of them too large to search with."""
    # Extremes of each row: a flag for each value would take a quarter of the map's memory. NaN fails any comparison.
    lowest, highest = means.min(axis=1, initial=0.0), means.max(axis=1, initial=0.0)
    return np.asarray((lowest >= -MAX_MEAN_VALUE) & (highest <= MAX_MEAN_VALUE))


def valid_positions(positions_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) whether each of (N, 3) positions is finite and on the Earth."""
    return np.asarray((np.abs(positions_m) <= MAX_COORDINATE_M).all(axis=1))


def _within(values: NDArray[Any], least: float, most: float) -> NDArray[np.bool_]:
    return np.asarray((values >= least) & (values <= most))
