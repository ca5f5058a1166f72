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

from offradar_ros.alignment.signature import Signature, SignatureConfig
from offradar_ros.alignment.twist import STANDING, Twist

Array = NDArray[np.float32]

_SMOOTH_CELLS, _SMOOTH_CELLS_OF_HALF = 0.5, 1.0
_ROUNDS = 2


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


def across_m(side: int, cell_m: float) -> Array:
    """(S,) float32 metres from the middle of an image to the centres of its pixels."""
    return ((np.arange(side) + 0.5 - side / 2.0) * cell_m).astype(np.float32)


def top_down(signature: Signature, twist: Twist = STANDING) -> TopDown:
    """The signature from above at its own resolution, as it would be if the vehicle had stood still at the stamp.

    A row of azimuth φ was measured at ``t = start + turn · φ/2π`` from where the vehicle was then: a point p of the
    frame is seen at ``R(−ω t) (p − v t)``, and t follows from there, found in a few rounds.
    """
    grid = signature.config.grid
    frame = _frame(signature.config)
    turns, range_m, seen = frame.turns, frame.range_m, frame.seen
    if signature.turn_s and twist != STANDING:
        for _ in range(_ROUNDS):
            t = np.float32(signature.start_s) + np.float32(signature.turn_s) * turns
            turns, range_m = _polar(
                frame.x_m - np.float32(twist.forward_mps) * t, frame.y_m - np.float32(twist.left_mps) * t
            )
            turns += np.float32(twist.yaw_radps / (2.0 * math.pi)) * t
            turns -= np.floor(turns)
        seen = _within(range_m, signature.config)
    columns = range_m * np.float32(1.0 / grid.resolution_m) - np.float32(0.5)
    # Row 0 of the wrapped image is the last sector.
    rows = turns * np.float32(grid.azimuths) + np.float32(0.5)
    image = _sampled(signature.image, columns, rows)
    if not signature.seen.all():
        sectors = np.repeat(signature.seen[:, None], grid.range_bins, axis=1)
        seen = seen * (_sampled(sectors, columns, rows) > 0.99)
    return TopDown(_smoothed(image, seen, _SMOOTH_CELLS), seen, grid.resolution_m)


def half(view: TopDown) -> TopDown:
    """The same at half the resolution."""
    side = view.side // 2
    smooth = _smoothed(view.image, view.seen, _SMOOTH_CELLS_OF_HALF)
    image = cv2.resize(smooth, (side, side), interpolation=cv2.INTER_AREA)
    seen = cv2.resize(view.seen, (side, side), interpolation=cv2.INTER_NEAREST)
    return TopDown(np.asarray(image, np.float32), np.asarray(seen, np.float32), 2.0 * view.cell_m)


def _smoothed(image: Array, seen: Array, sigma: float) -> Array:
    """The image smoothed over what is seen alone, so that its edges do not look like those of objects; 0 elsewhere."""
    weights = cv2.GaussianBlur(seen, (0, 0), sigma)
    return np.asarray(cv2.GaussianBlur(image * seen, (0, 0), sigma) / np.maximum(weights, 0.1) * seen, np.float32)


def _sampled(polar: NDArray[np.uint8] | NDArray[np.bool_], columns: Array, rows: Array) -> Array:
    wrapped = np.concatenate([polar[-1:], polar, polar[:1]]).astype(np.float32)
    return np.asarray(cv2.remap(wrapped, columns, rows, cv2.INTER_LINEAR), np.float32)


def _polar(x_m: Array, y_m: Array) -> tuple[Array, Array]:
    """Turns clockwise from forward, in [0, 1), and range in metres."""
    range_m, angle = cv2.cartToPolar(x_m, -y_m)
    return np.asarray(angle, np.float32) * np.float32(0.5 / math.pi), np.asarray(range_m, np.float32)


def _within(range_m: Array, config: SignatureConfig) -> Array:
    """(S, S) float32, 1 where a signature has values."""
    return ((range_m < config.reach_m) & (range_m > config.grid.min_range_m)).astype(np.float32)


@dataclasses.dataclass(frozen=True, eq=False)
class _Frame:
    """Where the pixels are; all (S, S) float32."""

    x_m: Array
    y_m: Array
    turns: Array
    range_m: Array
    seen: Array


@functools.lru_cache(maxsize=4)
def _frame(config: SignatureConfig) -> _Frame:
    middle_m = across_m(2 * config.grid.range_bins, config.grid.resolution_m)
    x_m, y_m = np.meshgrid(middle_m, middle_m)
    turns, range_m = _polar(x_m, y_m)
    return _Frame(x_m, y_m, turns, range_m, _within(range_m, config))
