"""From a rough pose to the pose of the largest correlation.

Enhanced correlation coefficient (Evangelidis and Psarakis, TPAMI 2008) with three unknowns, over the pixels of the
query where its image changes most. Brightness and contrast of the two scans may differ: the coefficient knows neither.
"""

from __future__ import annotations

import dataclasses
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.top_down import TopDown

Array = NDArray[np.float64]

_LONGEST_STEP_M, _LARGEST_TURN_RAD = 1.0, 0.03
_SMALL_M, _SMALL_RAD = 0.005, 1e-4
_FEWEST = 64
"""Pixels that must be seen by both scans."""


@dataclasses.dataclass(frozen=True, eq=False)
class Edges:
    """The pixels of a query where its image changes most.

    Attributes:
        points_m: (N, 2) float64, x and y.
        values: (N,) float64.
    """

    points_m: Array
    values: Array


@dataclasses.dataclass(frozen=True, eq=False)
class Slopes:
    """The image of a map scan and its derivatives.

    Attributes:
        layers: (S, S, 4) float32: value, its derivatives by x and by y in 1/m, and 1 where it is seen.
        cell_m: metres of a pixel.
    """

    layers: NDArray[np.float32]
    cell_m: float


@dataclasses.dataclass(frozen=True, eq=False)
class Refined:
    """A pose and how well the scans agree there.

    Attributes:
        pose: (3,) x, y in metres and yaw in radians of the query in the frame of the map scan.
        correlation: of the values that both scans have, −1 to 1.
        information: (3, 3) of the pose, the inverse of its covariance if the differences of pixels were independent.
    """

    pose: Array
    correlation: float
    information: Array


def edges(view: TopDown, most: int) -> Edges:
    """The `most` pixels of a query with the largest slope."""
    across_m = (np.arange(view.side) + 0.5 - view.side / 2.0) * view.cell_m
    # A slope at the edge of what is seen is that of the scan's reach.
    inside = cv2.erode(view.seen, np.ones((3, 3), np.uint8))
    slope = np.hypot(cv2.Sobel(view.image, -1, 1, 0), cv2.Sobel(view.image, -1, 0, 1)) * inside
    chosen = np.argpartition(-slope.ravel(), min(most, slope.size - 1))[:most]
    chosen = chosen[slope.ravel()[chosen] > 0.0]
    rows, columns = np.divmod(chosen, view.side)
    return Edges(np.column_stack([across_m[columns], across_m[rows]]), view.image.ravel()[chosen].astype(np.float64))


def slopes(view: TopDown) -> Slopes:
    """The image of a map scan with its derivatives."""
    scale = 1.0 / (8.0 * view.cell_m)
    dx, dy = cv2.Sobel(view.image, -1, 1, 0, scale=scale), cv2.Sobel(view.image, -1, 0, 1, scale=scale)
    return Slopes(np.dstack([view.image, dx, dy, view.seen]), view.cell_m)


def refine(place: Slopes, query: Edges, pose: Array, most_steps: int) -> Refined:
    """Climb from a pose to the largest correlation nearby."""
    found = Refined(pose, -1.0, np.zeros((3, 3)))
    if len(query.values) < _FEWEST:
        return found
    for _ in range(most_steps):
        value, jacobian, expected = _compared(place, query, pose)
        if len(value) < _FEWEST:
            return found
        normal = jacobian.T @ jacobian + 1e-9 * np.eye(3)
        inner, outer = jacobian.T @ value, jacobian.T @ expected
        solved = np.linalg.solve(normal, np.column_stack([inner, outer]))
        # Eq. 25: the contrast at which the linearised images agree best.
        contrast = (value @ value - inner @ solved[:, 0]) / max(value @ expected - inner @ solved[:, 1], 1e-9)
        residual = contrast * expected - value
        correlation = float(value @ expected) / max(float(np.linalg.norm(value)), 1e-9)
        found = Refined(pose, correlation, normal * (len(value) / max(float(residual @ residual), 1e-9)))
        step = contrast * solved[:, 1] - solved[:, 0]
        step[:2] = np.clip(step[:2], -_LONGEST_STEP_M, _LONGEST_STEP_M)
        step[2] = np.clip(step[2], -_LARGEST_TURN_RAD, _LARGEST_TURN_RAD)
        pose = pose + step
        if np.abs(step[:2]).max() < _SMALL_M and abs(step[2]) < _SMALL_RAD:
            break
    return dataclasses.replace(found, pose=pose)


def _compared(place: Slopes, query: Edges, pose: Array) -> tuple[Array, Array, Array]:
    """Values of the map scan where the query's pixels fall, their derivatives by the pose, and the query's values.

    All have mean 0; the query's have norm 1.
    """
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y = query.points_m.T
    x_m, y_m = cos * x - sin * y, sin * x + cos * y
    middle = len(place.layers) / 2.0 - 0.5
    columns = ((x_m + pose[0]) / place.cell_m + middle).astype(np.float32)[None]
    rows = ((y_m + pose[1]) / place.cell_m + middle).astype(np.float32)[None]
    value, dx, dy, seen = cv2.remap(place.layers, columns, rows, cv2.INTER_LINEAR)[0].T.astype(np.float64)
    by_yaw = dy * x_m - dx * y_m
    both = seen > 0.99
    jacobian, expected = np.column_stack([dx, dy, by_yaw])[both], query.values[both]
    value = value[both]
    if not len(value):
        return value, jacobian, expected
    expected = expected - expected.mean()
    norm = float(np.linalg.norm(expected))
    return value - value.mean(), jacobian - jacobian.mean(axis=0), expected / max(norm, 1e-9)
