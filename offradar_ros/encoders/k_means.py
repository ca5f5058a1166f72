"""k-means clustering with a seed."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

_ITERATIONS = 50


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
    """(count, F) centres of the points (N, F): k-means++ initialisation, then Lloyd's iterations by SciPy.

    A centre without points keeps its position. ValueError for fewer points than centres.
    """
    # Imported here, because it loads slowly and encoders with a fitted codebook do not need it.
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415

    if len(points) < count:
        raise ValueError(f'expected {count} points or more, got {len(points)}')
    start = _k_means_plus_plus(points, count, np.random.default_rng(seed))
    with warnings.catch_warnings():
        # Where points are equal, some centres have none.
        warnings.filterwarnings('ignore', message='One of the clusters is empty')
        centres, _ = kmeans2(points, start, iter=_ITERATIONS, minit='matrix')
    return np.asarray(centres, np.float32)


def _k_means_plus_plus(points: NDArray[np.float32], count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Initial centres by k-means++ (Arthur and Vassilvitskii, 2007): random points, with probability ∝ distance².

    O(K·N·F). SciPy's implementation computes the distances to all centres again for each new one, O(K²·N·F): minutes
    for a map.
    """
    centres = [points[rng.integers(len(points))]]
    squared = np.full(len(points), np.inf)
    while len(centres) < count:
        squared = np.minimum(squared, np.square(points - centres[-1]).sum(axis=1))
        total = float(squared.sum())
        probability = squared / total if total > 0.0 else None
        centres.append(points[rng.choice(len(points), p=probability)])
    return np.stack(centres)
