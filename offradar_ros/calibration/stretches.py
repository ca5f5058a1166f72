"""The ground of a road in parts: within one, the errors of answers are correlated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SQUARE_M = 100.0
"""Side of a square of ground."""


def squares(positions_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N,) index of the square of `SQUARE_M` in which each of (N, 2) positions lies."""
    corners = np.floor(positions_m / SQUARE_M)
    return np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def stretches(positions_m: NDArray[np.float64], halvings: int) -> NDArray[np.int64]:
    """(N,) number, 0 to 2^halvings − 1, of the part of the ground in which each of (N, 2) positions lies.

    The ground is cut at the median of the wider of x and y, and so is each half again: all parts hold about as many
    positions, and all drives have their parts in the same place.
    """
    found = np.zeros(len(positions_m), np.int64)
    if halvings == 0 or not len(positions_m):
        return found
    wider = int(np.argmax(np.ptp(positions_m, axis=0)))
    beyond = positions_m[:, wider] > np.median(positions_m[:, wider])
    for half, first in ((~beyond, 0), (beyond, 2 ** (halvings - 1))):
        found[half] = first + stretches(positions_m[half], halvings - 1)
    return found
