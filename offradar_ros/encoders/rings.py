"""Polar power in rings of equal width in metres.

Convention: ring i covers ranges [i, i + 1) · max_range_m / rings, and bin k covers ``range_offset_m`` +
[k, k + 1) · ``range_resolution_m``. Rows stay azimuths.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan


def ring_power(scan: PolarScan, rings: int, max_range_m: float, min_range_m: float) -> NDArray[np.float64]:
    """(A, rings) float64 mean power of each ring on each azimuth; range bins are weighted by their overlap.

    Power nearer than `min_range_m` and beyond the last bin counts as zero.
    """
    bins = scan.power.shape[1]
    edges_m = np.maximum(np.linspace(0.0, max_range_m, rings + 1), min_range_m)
    edges = np.clip((edges_m - scan.range_offset_m) / scan.range_resolution_m, 0.0, bins)
    first = np.minimum(edges.astype(np.intp), bins - 1)
    # Whole bins are summed as integers; then the parts of bins at the edges are moved between neighbouring rings.
    whole = np.add.reduceat(scan.power, first, axis=1, dtype=np.uint32)[:, :-1] * (np.diff(first) > 0)
    parts = scan.power[:, first] * (edges - first)
    bins_per_ring = max_range_m / rings / scan.range_resolution_m
    power: NDArray[np.float64] = (whole - parts[:, :-1] + parts[:, 1:]) / bins_per_ring
    return power
