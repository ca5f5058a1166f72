"""k-means of many vectors, seeded. NumPy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_ITERATIONS = 100
_TOLERANCE = 1e-4


def nearest_centres(
    points: NDArray[np.floating], centres: NDArray[np.floating]
) -> tuple[NDArray[np.intp], NDArray[np.floating]]:
    """Index (N,) of the centre (K, F) nearest to each of the points (N, F), and the distance (N,) to it."""
    squared = (centres * centres).sum(axis=1) - 2.0 * (points @ centres.T)
    nearest = squared.argmin(axis=1)
    smallest = np.take_along_axis(squared, nearest[:, np.newaxis], axis=1)[:, 0]
    return nearest, np.sqrt(np.maximum(smallest + (points * points).sum(axis=1), 0.0))


def group_sums(
    points: NDArray[np.floating], groups: NDArray[np.intp], count: int
) -> tuple[NDArray[np.floating], NDArray[np.intp]]:
    """Sum (count, F) and number (count,) of the points (N, F) of each group 0…count − 1, as one matrix product."""
    members = (np.arange(count)[:, np.newaxis] == groups).astype(points.dtype)
    return members @ points, np.bincount(groups, minlength=count)


def k_means(points: NDArray[np.float32], count: int, seed: int) -> NDArray[np.float32]:
    """(count, F) centres of the points (N, F): k-means++ to start with, then Lloyd's iterations until they rest.

    A centre that loses all of its points moves to the point that is furthest from its own. ValueError for fewer points
    than centres.
    """
    if len(points) < count:
        raise ValueError(f'expected {count} points or more, got {len(points)}')
    rng = np.random.default_rng(seed)
    centres = _spread_out(points, count, rng)
    rest = _TOLERANCE * float(points.var(axis=0).mean())
    for _ in range(_ITERATIONS):
        nearest, distances = nearest_centres(points, centres)
        sums, sizes = group_sums(points, nearest, count)
        moved = (sums / np.maximum(sizes, 1)[:, np.newaxis]).astype(np.float32)
        empty = np.flatnonzero(sizes == 0)
        moved[empty] = points[np.argsort(distances)[::-1][: len(empty)]]
        shift = float(np.square(moved - centres).sum())
        centres = moved
        if shift <= rest:
            break
    return centres


def _spread_out(points: NDArray[np.float32], count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """k-means++ (Arthur and Vassilvitskii, 2007): each next centre is a point, far ones being likelier."""
    centres = [points[rng.integers(len(points))]]
    squared = np.full(len(points), np.inf)
    while len(centres) < count:
        squared = np.minimum(squared, np.square(points - centres[-1]).sum(axis=1))
        total = float(squared.sum())
        chance = squared / total if total > 0.0 else None
        centres.append(points[rng.choice(len(points), p=chance)])
    return np.stack(centres)
