"""From rough poses to poses of the largest correlation nearby.

Enhanced correlation coefficient (Evangelidis and Psarakis, TPAMI 2008) in its inverse compositional form, with three
unknowns, over the pixels of the query where its image changes most. Brightness and contrast of the two scans may
differ: the coefficient knows neither. What belongs to the query alone is computed once, and several poses are refined
at the same time.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.alignment.top_down import TopDown, across_m

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_LARGEST_STEP = np.array([1.0, 1.0, 0.03])
_SMALL_STEP = np.array([0.01, 0.01, 2e-4])
"""Metres, metres and radians."""
_CONVINCING = 200
"""Pixels whose correlation counts half: that of fewer is often chance."""
_OUTLYING = 3.0
"""Standard deviations at which a pixel counts half."""
_LEAST_COSINE, _LEAST_POWER = 0.1, 1e-6
_REGULAR = 1e-6 * np.eye(4)
_SECTORS, _RINGS_M = 12, (14.0, 26.0, 44.0)
"""Patches of the query: sectors between its ranges. Nearly as many pixels lie in each ring."""
_FEWEST = 20
"""Pixels of a patch from which on its correlation counts."""
_CONVINCING_PATCHES = 2.0
"""Patches whose mean correlation counts half."""
_FLAT = 1e-3
"""Variance of a patch without structure, in squared levels."""
_UNSEEN = -1e6
"""Stands for no value: values are not negative, and no mean of this and a few of them is either."""


@dataclasses.dataclass(frozen=True, eq=False)
class Edges:
    """The pixels of a query where its image changes most, patch by patch.

    Attributes:
        points_m: (3, N) float32, x, y and 1.
        terms: (5, N) float32: 1, derivatives of the value as the query moves along x and y and turns, and the value.
        products: (25, N) float32, of each two terms.
        starts: (B,) int64, the first pixel of each patch that has any.
    """

    points_m: Image
    terms: Image
    products: Image
    starts: NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """The image of a map scan.

    Attributes:
        image: (S, S) float32, `_UNSEEN` where it has no value.
        cell_m: metres of a pixel.
    """

    image: Image
    cell_m: float


@dataclasses.dataclass(frozen=True, eq=False)
class Refined:
    """Poses and how well the scans agree there.

    Attributes:
        poses: (K, 3) x, y in metres and yaw in radians of the query in the frame of the map scan.
        correlations: (K,) of the values that both scans have, −1 to 1, nearer to 0 where these are few.
        covariances: (K, 3, 3) of each pose in the frame of the query, as if the differences of pixels were independent.
    """

    poses: Array
    correlations: Array
    covariances: Array


def edges(view: TopDown, most: int) -> Edges:
    """The `most` pixels of a query with the largest slope."""
    scale = 1.0 / (8.0 * view.cell_m)
    dx, dy = cv2.Sobel(view.image, -1, 1, 0, scale=scale), cv2.Sobel(view.image, -1, 0, 1, scale=scale)
    # A slope at the edge of what is seen is that of the scan's reach.
    slope = ((dx * dx + dy * dy) * cv2.erode(view.seen, np.ones((3, 3), np.uint8))).ravel()
    chosen = np.flatnonzero(slope)
    if len(chosen) > most:
        chosen = chosen[np.argpartition(-slope[chosen], most)[:most]]
    middle_m = across_m(view.side, view.cell_m)
    y_m, x_m = middle_m[chosen // view.side], middle_m[chosen % view.side]
    patch = _patch_of(x_m, y_m)
    order = np.argsort(patch, kind='stable')
    chosen, x_m, y_m = chosen[order], x_m[order], y_m[order]
    starts = np.flatnonzero(np.diff(patch[order], prepend=-1))
    value, dx, dy = (image.ravel()[chosen] for image in (view.image, dx, dy))
    ones = np.ones_like(value)
    terms = np.stack([ones, dx, dy, dy * x_m - dx * y_m, value])
    products = (terms[:, None, :] * terms[None, :, :]).reshape(25, -1)
    return Edges(np.stack([x_m, y_m, ones]), terms, products, starts)


def _patch_of(x_m: Image, y_m: Image) -> NDArray[np.int64]:
    """(N,) int64 number of the patch of each of (N,) points, 0 or more."""
    sector = np.floor((np.arctan2(y_m, x_m) / (2.0 * np.pi) + 0.5) * _SECTORS).astype(np.int64) % _SECTORS
    ring = np.digitize(np.hypot(x_m, y_m), _RINGS_M)
    return np.asarray(sector * (len(_RINGS_M) + 1) + ring, np.int64)


def surface(view: TopDown) -> Surface:
    """The image of a map scan, ready to be sampled."""
    return Surface(np.where(view.seen > 0.0, view.image, np.float32(_UNSEEN)), view.cell_m)


def refine(places: Sequence[Surface], query: Edges, poses: Array, most_steps: int) -> Refined:
    """Climb from (K, 3) poses, each in the frame of its own place, to the largest correlations nearby."""
    if not query.terms.size:
        return Refined(poses, np.zeros(len(poses)), np.zeros((len(poses), 3, 3)))
    poses, found = poses.copy(), _compared(places, query, poses)
    for _ in range(most_steps):
        # What has arrived is left alone, so that no result depends on what else is refined.
        (moving,) = np.nonzero((np.abs(found.steps) >= _SMALL_STEP).any(axis=1))
        if not len(moving):
            break
        poses[moving] = _moved(poses[moving], found.steps[moving])
        again = _compared([places[row] for row in moving.tolist()], query, poses[moving])
        for before, after in zip(found, again, strict=True):
            before[moving] = after
    covariances = np.asarray(np.linalg.inv(found.information), np.float64)
    return Refined(poses, found.correlations, covariances[:, 1:, 1:])


def correlations(places: Sequence[Surface], query: Edges, poses: Array) -> Array:
    """(K,) `Refined.correlations` at (K, 3) poses, each in the frame of its own place."""
    if not query.terms.size:
        return np.zeros(len(poses))
    return _agreement(*_sampled(places, query.points_m, poses), query.terms[4]).correlation


def agreement(places: Sequence[Surface], query: Edges, poses: Array) -> Array:
    """(K,) how well the scans agree at (K, 3) poses, −1 to 1: the mean of the correlations in each patch of the query.

    One strong return, or a row of walls, makes scans of different places correlate as a whole. In most patches at once
    only scans of one place do. A mean of few patches is drawn to 0.
    """
    if not query.terms.size:
        return np.zeros(len(poses))
    value, both = _sampled(places, query.points_m, poses)
    own = query.terms[4]
    seen = both * own
    sums = (
        np.add.reduceat(of, query.starts, axis=1) for of in (both, seen, value, seen * own, value * value, value * own)
    )
    count, t, i, tt, ii, ti = sums
    pixels = np.maximum(count, 1.0)
    tt, ii, ti = (tt - t * t / pixels) / pixels, (ii - i * i / pixels) / pixels, (ti - t * i / pixels) / pixels
    counted = (count >= _FEWEST).astype(np.float64)
    of_each = counted * ti / np.sqrt(np.maximum(tt, _FLAT) * np.maximum(ii, _FLAT))
    found: Array = of_each.sum(axis=1) / (counted.sum(axis=1) + _CONVINCING_PATCHES)
    return found


class _Compared(NamedTuple):
    """How well the query's pixels agree with the map scan where they fall.

    Attributes:
        correlations: (K,)
        steps: (K, 3) of the query in its own frame, after which it would agree best.
        information: (K, 4, 4) of brightness and step.
    """

    correlations: Array
    steps: Array
    information: Array


def _compared(places: Sequence[Surface], query: Edges, poses: Array) -> _Compared:
    """Least squares over brightness and step, once for the query's values t and once for the map scan's values i.

    Pixels that differ much, as where a vehicle stood, count little (Cauchy's weights).
    """
    value, both = _sampled(places, query.points_m, poses)
    found = _agreement(value, both, query.terms[4])
    # Ready-made arrays: of a few thousand pixels, as much time goes into new ones as into arithmetic.
    weights = np.square(found.residuals, out=found.residuals)
    weights *= 1.0 / (_OUTLYING**2 * found.variance[:, None])
    weights += 1.0
    np.divide(both, weights, out=weights)
    value *= weights
    sums = (weights @ query.products.T).reshape(-1, 5, 5).astype(np.float64)
    across = (value @ query.terms.T).astype(np.float64)
    normal = sums[:, :4, :4] + _REGULAR
    sides = np.empty((len(poses), 4, 2))
    sides[..., 0], sides[..., 1] = sums[:, :4, 4], across[:, :4]
    solved = np.linalg.solve(normal, sides)
    # Eq. 25: the contrast at which the linearised images agree best.
    explained = np.einsum('kn,knm->km', sides[..., 0], solved)
    left, agreeing = sums[:, 4, 4] - explained[:, 0], across[:, 4] - explained[:, 1]
    contrast = np.clip(left / np.maximum(agreeing, _LEAST_POWER), 0.0, found.contrast / _LEAST_COSINE)
    step = contrast[:, None] * solved[:, 1:, 1] - solved[:, 1:, 0]
    step = np.minimum(np.maximum(step, -_LARGEST_STEP), _LARGEST_STEP)
    return _Compared(found.correlation, step, normal / found.noise[:, None, None])


class _Agreement(NamedTuple):
    """How alike the values of both scans are, whatever their brightness and contrast.

    Attributes:
        correlation: (K,)
        contrast: (K,) of the query over that of the map scan.
        residuals: (K, N) float32, differences at that contrast, as values of the query.
        variance: (K,) of the residuals of the pixels that both scans have.
        noise: (K,) variance of what the query does not share with the map scan, over the share of the rest.
    """

    correlation: Array
    contrast: Array
    residuals: Image
    variance: Array
    noise: Array


def _agreement(value: Image, both: Image, own: Image) -> _Agreement:
    count = np.maximum(both.sum(axis=1), 1.0)
    t_mean, i_mean = both @ own / count, value.sum(axis=1) / count
    tt = np.maximum(both @ (own * own) - count * t_mean * t_mean, _LEAST_POWER)
    ii = np.maximum(np.einsum('kn,kn->k', value, value) - count * i_mean * i_mean, _LEAST_POWER)
    correlation = (value @ own - count * t_mean * i_mean) / np.sqrt(tt * ii)
    contrast = np.sqrt(tt / ii)
    residuals = contrast[:, None] * value
    residuals -= own
    residuals += (t_mean - contrast * i_mean)[:, None]
    variance = np.maximum(2.0 * tt * (1.0 - correlation) / count, _LEAST_POWER)
    shared = np.maximum(correlation, _LEAST_COSINE) ** 2
    noise = np.maximum(tt * (1.0 - shared) / (shared * count), _LEAST_POWER)
    return _Agreement(correlation * (count / (count + _CONVINCING)), contrast, residuals, variance, noise)


def _sampled(places: Sequence[Surface], points_m: Image, poses: Array) -> tuple[Image, Image]:
    """(K, N) the map scans where the query's pixels fall, 0 for no value, and whether they have one there."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    cell_m = places[0].cell_m
    middle_m = (len(places[0].image) / 2.0 - 0.5) * cell_m
    to_column = np.array([cos, -sin, poses[:, 0] + middle_m]).T / cell_m
    to_row = np.array([sin, cos, poses[:, 1] + middle_m]).T / cell_m
    columns, rows = to_column.astype(np.float32) @ points_m, to_row.astype(np.float32) @ points_m
    value = np.empty_like(columns)
    end = 0
    # Poses at one place follow one another: one call for all of them.
    for _, alike in itertools.groupby(places, key=id):
        start, end = end, end + len(list(alike))
        part, image = slice(start, end), places[start].image
        cv2.remap(image, columns[part], rows[part], cv2.INTER_LINEAR, value[part], cv2.BORDER_CONSTANT, _UNSEEN)
    both = (value >= 0.0).astype(np.float32)
    return np.maximum(value, 0.0, out=value), both


def _moved(poses: Array, steps: Array) -> Array:
    """The poses, each moved so that the query's image at `steps` falls where it was."""
    yaws = poses[:, 2] - steps[:, 2]
    cos, sin = np.cos(yaws), np.sin(yaws)
    x_m = poses[:, 0] - cos * steps[:, 0] + sin * steps[:, 1]
    y_m = poses[:, 1] - sin * steps[:, 0] - cos * steps[:, 1]
    return np.asarray(np.array([x_m, y_m, yaws]).T, np.float64)
