"""Spatial uncertainty estimation (SUE; Zaffar, Nan and Kooij, CVPR 2024): how scattered the nearest places are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STEEPNESS = 20.0
"""Weights fall as exp(−STEEPNESS · (d − d₁) / d₁): chosen on the protocol `confidence`; in the original exp(−350 d)."""

FARTHEST_M = 500.0
"""A place farther than this from the mean, along either axis, counts as this far, as in the original."""

_LEAST = 1e-9
"""A smaller distance to the nearest place counts as this."""


def spatial_variance(distances: NDArray[np.float64], positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The weighted variance of the positions of the k nearest places; a high one is a low confidence.

    Args:
        distances: (Q, k) in embedding space, nearest first; infinite where there are less than k places.
        positions_m: (Q, k, 2) of these places, metres.

    Returns:
        (Q,) float64 in m², the mean of the variances along both axes.
    """
    first = np.maximum(distances[:, :1], _LEAST)
    weights = np.exp(-STEEPNESS * (distances - first) / first)
    weights /= weights.sum(axis=1, keepdims=True)
    mean_m = np.einsum('qk,qka->qa', weights, positions_m)
    away_m = np.clip(positions_m - mean_m[:, np.newaxis], -FARTHEST_M, FARTHEST_M)
    variance: NDArray[np.float64] = np.einsum('qk,qka->q', weights, away_m**2) / 2.0
    return variance
