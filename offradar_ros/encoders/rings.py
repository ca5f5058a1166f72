"""Polar power gathered into rings of equal width in metres.

Convention: ring i spans [i, i + 1) · max_range_m / rings from the sensor, whatever its range bins are; bin k spans
``range_offset_m`` + [k, k + 1) · ``range_resolution_m``. Rows stay azimuths.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.types import PolarScan


def ring_power(scan: PolarScan, rings: int, max_range_m: float, min_range_m: float) -> NDArray[np.float64]:
    """(A, rings) float64 mean power of each ring on each azimuth, weighting range bins by the length that they share.

    Nothing is received nearer than `min_range_m` or beyond the last bin: such lengths count as zero power.
    """
    bins = scan.power.shape[1]
    edges_m = np.maximum(np.linspace(0.0, max_range_m, rings + 1), min_range_m)
    edges = np.clip((edges_m - scan.range_offset_m) / scan.range_resolution_m, 0.0, bins)
    first = np.minimum(edges.astype(np.intp), bins - 1)
    # Whole bins are summed as integers; the parts of bins that the edges cut off are then moved from ring to ring.
    whole = np.add.reduceat(scan.power, first, axis=1, dtype=np.uint32)[:, :-1] * (np.diff(first) > 0)
    parts = scan.power[:, first] * (edges - first)
    bins_per_ring = max_range_m / rings / scan.range_resolution_m
    power: NDArray[np.float64] = (whole - parts[:, :-1] + parts[:, 1:]) / bins_per_ring
    return power
