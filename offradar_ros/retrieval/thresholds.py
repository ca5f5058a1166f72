"""Static thresholds on U (Sec. III-C of the paper)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import QueryConfig


def static_thresholds(delta: float, levels: int) -> NDArray[np.float64]:
    """T = {(1 − Δ) + n·2Δ/N | n ∈ [0, N]}: (N + 1,) float64, ascending.

    The prior's variance is 1, so that the thresholds depend on Δ and N only, not on the scans.
    """
    return (1.0 - delta) + np.arange(levels + 1) * 2.0 * delta / levels


def threshold_at(config: QueryConfig) -> float:
    """The threshold of level n, which is in use: a scan whose U is above it is rejected."""
    return float(static_thresholds(config.delta, config.levels)[config.level])
