"""Exact Euclidean nearest neighbours of many descriptors at once, as `retrieval.PlaceIndex` finds them one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_BLOCK = 256


def squared_distances(queries: NDArray[np.float32], places: NDArray[np.float32]) -> NDArray[np.float64]:
    """(Q, P) squared distances of (Q, d) queries, some hundred at a time, and (P, d) places; rounding may leave −ε.

    Products are of double precision: |x|² + |q|² − 2 x·q cancels badly in single precision.
    """
    asked = queries.astype(np.float64)
    squares = np.empty((len(asked), len(places)), np.float64)
    lengths = np.einsum('qd,qd->q', asked, asked)
    for start in range(0, len(places), _BLOCK):
        block = places[start : start + _BLOCK].astype(np.float64)
        own = np.einsum('pd,pd->p', block, block)
        part = asked @ (-2.0 * block.T)
        part += own
        part += lengths[:, None]
        squares[:, start : start + _BLOCK] = part
    return squares


def k_least(values: NDArray[np.float64], k: int) -> NDArray[np.intp]:
    """(Q, k) columns of the k least of (Q, P) values, k ≤ P, ascending; of equal ones the first, NaN last."""
    if k == 1 and not np.isnan(values).any():
        return np.asarray(values.argmin(axis=1), np.intp)[:, None]
    picked = np.argpartition(values, k - 1, axis=1)[:, :k]
    order = np.lexsort((picked, np.take_along_axis(values, picked, 1)), axis=1)
    rows = np.take_along_axis(picked, order, 1)
    # Where others tie with the k-th, or nothing can be compared, a partition picks any of them.
    bound = np.take_along_axis(values, rows[:, -1:], 1)
    unclear = (values <= bound).sum(axis=1) != k
    rows[unclear] = np.argsort(values[unclear], axis=1, kind='stable')[:, :k]
    return rows
