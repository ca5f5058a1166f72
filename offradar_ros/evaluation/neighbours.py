"""Exact Euclidean nearest neighbours of many descriptors at once, as `retrieval.PlaceIndex` finds them one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_BLOCK = 256


def nearest(
    queries: NDArray[np.float32], places: NDArray[np.float32], k: int
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Rows of the k nearest of (P, d) places to each of (Q, d) queries, nearest first, and their distances.

    Both are (Q, min(k, P)); of equally near places the first comes first. A query with a NaN finds places in their
    order at a NaN distance. Products are of double precision: |x|² + |q|² − 2 x·q cancels badly in single precision.
    """
    k = min(k, len(places))
    rows = np.empty((len(queries), k), np.intp)
    distances = np.empty((len(queries), k), np.float64)
    for start in range(0, len(queries), _BLOCK):
        part = slice(start, start + _BLOCK)
        squares = _squares(queries[part].astype(np.float64), places)
        rows[part] = np.argsort(squares, axis=1, kind='stable')[:, :k]
        distances[part] = np.sqrt(np.maximum(np.take_along_axis(squares, rows[part], axis=1), 0.0))
    return rows, distances


def _squares(queries: NDArray[np.float64], places: NDArray[np.float32]) -> NDArray[np.float64]:
    squares = np.empty((len(queries), len(places)), np.float64)
    lengths = np.einsum('qd,qd->q', queries, queries)
    for start in range(0, len(places), _BLOCK):
        block = places[start : start + _BLOCK].astype(np.float64)
        own = np.einsum('pd,pd->p', block, block)
        squares[:, start : start + _BLOCK] = lengths[:, None] + own - 2.0 * (queries @ block.T)
    return squares
