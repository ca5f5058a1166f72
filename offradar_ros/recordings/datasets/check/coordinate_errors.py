"""Errors that keep the positions of two sequences of one place apart: axes, sign, zone, or a constant offset."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from offradar_ros.geometry import LocalFrame
from offradar_ros.recordings.datasets.check.route import Route, nearest, route, share_near

# A route of which this share lies on another, once it is moved, is the same route.
_FITS = 0.8
_FIT_M = 10.0
# A street without turns fits many others.
_NARROWEST_M = 30.0
_CELL_M = 20.0
_MOST_POINTS = 1000
_ZONE_DEG = np.array([0.0, 6.0, 0.0])

_Move = Callable[[NDArray[np.float64]], NDArray[np.float64]]
_ERRORS: dict[str, _Move] = {
    'with latitude and longitude exchanged': lambda lla: lla[:, [1, 0, 2]],
    'with the sign of the longitude changed': lambda lla: lla * (1.0, -1.0, 1.0),
    'in the next UTM zone to the east': lambda lla: lla + _ZONE_DEG,
    'in the next UTM zone to the west': lambda lla: lla - _ZONE_DEG,
}


def coordinate_error(points_lla: NDArray[np.float64], other: Route, frame: LocalFrame) -> str:
    """The change that puts (N, 3) latitude°, longitude°, altitude m on `other`, a route in `frame`; empty if none."""
    for text, move in _ERRORS.items():
        moved = move(points_lla)
        if np.abs(moved[:, 0]).max() <= 90.0 and share_near(route(moved, frame).scans, other.line) >= _FITS:
            return text
    offset_m = _offset_m(route(points_lla, frame), other)
    if offset_m is None:
        return ''
    east_m, north_m = offset_m
    return f'moved by a constant {east_m:.0f} m to the east and {north_m:.0f} m to the north'


def _offset_m(moving: Route, other: Route) -> NDArray[np.float64] | None:
    """East and north in metres that bring one route onto the other; None where no offset does."""
    if len(moving.line) < 3 or _width_m(moving.line) < _NARROWEST_M:
        return None
    points_m, line_m = (_subsampled(r.line[:, :2]) for r in (moving, other))
    offset_m = _most_voted(points_m, line_m)
    for _ in range(10):
        away_m, which = nearest(points_m + offset_m, line_m)
        close = away_m <= 2 * _CELL_M
        if not close.any():
            return None
        offset_m = offset_m + np.median((line_m[which] - points_m - offset_m)[close], axis=0)
    fits = share_near(moving.scans[:, :2] + offset_m, other.line[:, :2], _FIT_M) >= _FITS
    return offset_m if fits else None


def _most_voted(points_m: NDArray[np.float64], line_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The difference that most pairs of points have, to a cell."""
    differences_m = (line_m[None, :, :] - points_m[:, None, :]).reshape(-1, 2)
    cells, counts = np.unique(np.floor(differences_m / _CELL_M).astype(np.int64) @ (2**32, 1), return_counts=True)
    most = int(cells[np.argmax(counts)])
    north = (most + 2**31) % 2**32 - 2**31
    return (np.array([(most - north) // 2**32, north]) + 0.5) * _CELL_M


def _subsampled(line_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return line_m[:: -(-len(line_m) // _MOST_POINTS)]


def _width_m(line_m: NDArray[np.float64]) -> float:
    """Standard deviation across the direction in which a line extends most."""
    spread = np.linalg.eigvalsh(np.cov(line_m[:, :2].T))
    return float(np.sqrt(max(spread[0], 0.0)))
