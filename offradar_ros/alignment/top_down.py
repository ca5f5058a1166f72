"""A signature seen from above, with the motion of the vehicle during its sweep taken out.

Convention: the frame of the vehicle at the scan's stamp, x forward, y to the left (REP 103). Columns of the image grow
with x and rows with y, the vehicle is in the middle; pixel i is centred at ``(i + 0.5 − S/2) · cell`` metres.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.signature import Signature
from offradar_ros.config import PolarGridConfig

Array = NDArray[np.float32]

_SMOOTH_CELLS = 0.8
_ROUNDS = 2


@dataclasses.dataclass(frozen=True)
class Twist:
    """Velocity of a vehicle in its own frame (REP 103): metres a second forward and to the left, radians a second."""

    forward_mps: float = 0.0
    left_mps: float = 0.0
    yaw_radps: float = 0.0


STANDING = Twist()


@dataclasses.dataclass(frozen=True, eq=False)
class TopDown:
    """A scan seen from above.

    Attributes:
        image: (S, S) float32, smooth, so that it can be compared between pixels.
        seen: (S, S) float32, 1 where the scan has a value, 0 beyond its reach and in sectors that it lacks.
        cell_m: metres of a pixel.
    """

    image: Array
    seen: Array
    cell_m: float

    @property
    def side(self) -> int:
        """S."""
        return len(self.image)


def top_down(signature: Signature, twist: Twist = STANDING) -> TopDown:
    """The signature from above at its own resolution, as it would be if the vehicle had stood still at the stamp.

    A row of azimuth φ was measured at ``t = start + turn · φ/2π`` from where the vehicle was then: a point p of the
    frame is seen at ``R(−ω t) (p − v t)``, and t follows from there, found in a few rounds.
    """
    config = signature.config
    x_m, y_m = _grid(config.grid)
    turns, range_m = _polar(x_m, y_m)
    if signature.turn_s and twist != STANDING:
        for _ in range(_ROUNDS):
            t = signature.start_s + signature.turn_s * turns
            cos, sin = np.cos(twist.yaw_radps * t), np.sin(twist.yaw_radps * t)
            dx, dy = x_m - twist.forward_mps * t, y_m - twist.left_mps * t
            turns, range_m = _polar(cos * dx + sin * dy, cos * dy - sin * dx)
    grid = config.grid
    columns = (range_m / grid.resolution_m - 0.5).astype(np.float32)
    # Row 0 of the wrapped image is the last sector.
    rows = (turns * grid.azimuths + 0.5).astype(np.float32)
    image = _sampled(signature.image.astype(np.float32), columns, rows)
    has = (range_m < config.reach_m) & (range_m > grid.min_range_m)
    seen = has.astype(np.float32)
    if not signature.seen.all():
        sectors = np.repeat(signature.seen[:, None], grid.range_bins, axis=1).astype(np.float32)
        seen *= _sampled(sectors, columns, rows) > 0.99
    return TopDown(_smoothed(image * seen, _SMOOTH_CELLS), seen, grid.resolution_m)


def half(view: TopDown) -> TopDown:
    """The same at half the resolution."""
    side = view.side // 2
    image = cv2.resize(_smoothed(view.image, 1.5 * _SMOOTH_CELLS), (side, side), interpolation=cv2.INTER_AREA)
    seen = cv2.resize(view.seen, (side, side), interpolation=cv2.INTER_NEAREST)
    return TopDown(np.asarray(image, np.float32), np.asarray(seen, np.float32), 2.0 * view.cell_m)


def _smoothed(image: Array, sigma: float) -> Array:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma), np.float32)


def _sampled(polar: Array, columns: Array, rows: Array) -> Array:
    wrapped = np.concatenate([polar[-1:], polar, polar[:1]])
    return np.asarray(cv2.remap(wrapped, columns, rows, cv2.INTER_LINEAR), np.float32)


def _polar(x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Turns clockwise from forward, in [0, 1), and range in metres."""
    return np.mod(np.arctan2(-y_m, x_m) / (2.0 * math.pi), 1.0), np.hypot(x_m, y_m)


@functools.lru_cache(maxsize=4)
def _grid(config: PolarGridConfig) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    side = 2 * config.range_bins
    across_m = (np.arange(side) + 0.5 - side / 2.0) * config.resolution_m
    x_m, y_m = np.meshgrid(across_m, across_m)
    return x_m, y_m
