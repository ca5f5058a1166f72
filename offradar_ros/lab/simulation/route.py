"""The line that drives through a simulated world follow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Route:
    """A smooth line by arc length. A closed one repeats; beyond the ends of an open one its end poses hold.

    Positions are metres east and north, headings counter-clockwise from east.
    """

    def __init__(self, corners_m: Array, closed: bool, corner_length_m: int = 16) -> None:
        """Through `corners_m` (N, 2), rounded over `corner_length_m`; a closed one does not repeat its first corner."""
        self.closed = closed
        line = _every_metre(_closed(corners_m) if closed else corners_m)
        smooth = np.stack([_smoothed(line[:, axis], closed, corner_length_m) for axis in range(2)], axis=1)
        self.points_m = _every_metre(_closed(smooth) if closed else smooth)
        self._arc_m = _arc(self.points_m)
        self.length_m = float(self._arc_m[-1])
        steps = np.gradient(self.points_m, axis=0)
        if closed:
            steps[0] = steps[-1] = self.points_m[1] - self.points_m[-2]
        self._headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))

    def at(self, arc_m: Array, left_m: Array | float = 0.0) -> Array:
        """(N, 3) x, y, heading at (N,) arc lengths, `left_m` to the left of the line."""
        inside = np.mod(arc_m, self.length_m) if self.closed else arc_m
        x_m, y_m = (np.interp(inside, self._arc_m, self.points_m[:, axis]) for axis in range(2))
        heading = np.interp(inside, self._arc_m, self._headings)
        return np.column_stack([x_m - left_m * np.sin(heading), y_m + left_m * np.cos(heading), heading])


def polyline_at(line_m: Array, along_m: Array, left_m: Array) -> Array:
    """(N, 3) x, y, heading at (N,) arc lengths of an (M, 2) polyline, (N,) metres to the left of it."""
    arc, steps = _arc(line_m), np.diff(line_m, axis=0)
    x_m, y_m = (np.interp(along_m, arc, line_m[:, axis]) for axis in range(2))
    piece = np.clip(np.searchsorted(arc, along_m, side='right') - 1, 0, len(steps) - 1)
    heading = np.arctan2(steps[piece, 1], steps[piece, 0])
    return np.column_stack([x_m - left_m * np.sin(heading), y_m + left_m * np.cos(heading), heading])


def _closed(points_m: Array) -> Array:
    return np.vstack([points_m, points_m[:1]])


def _arc(points_m: Array) -> Array:
    steps = np.diff(points_m, axis=0)
    return np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])


def _every_metre(points_m: Array) -> Array:
    """(K, 2) points about a metre apart along an (M, 2) polyline, with its ends."""
    arc = _arc(points_m)
    stations = np.linspace(0.0, arc[-1], max(2, round(arc[-1]) + 1))
    return np.stack([np.interp(stations, arc, points_m[:, axis]) for axis in range(2)], axis=1)


def _smoothed(values: Array, closed: bool, width: int) -> Array:
    """Moving mean; the repeated end of a closed line is dropped, the ends of an open line do not move."""
    if closed:
        padded = np.pad(values[:-1], width, mode='wrap')
    else:
        padded = np.pad(values, width, mode='reflect', reflect_type='odd')
    return np.convolve(padded, np.full(2 * (width // 2) + 1, 1.0 / (2 * (width // 2) + 1)), 'same')[width:-width]
