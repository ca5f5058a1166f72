"""How far probabilities are from what happened."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def expected_calibration_error(p_right: NDArray[np.float64], right: NDArray[np.bool_], bins: int = 15) -> float:
    """Σ_b n_b/n |mean p − share right| over equal intervals of (Q,) p (Guo et al., ICML 2017)."""
    rows = np.minimum((p_right * bins).astype(np.int64), bins - 1)
    gaps = np.bincount(rows, p_right - right, bins)
    return float(np.abs(gaps).sum() / len(right))


def brier_score(p_right: NDArray[np.float64], right: NDArray[np.bool_]) -> float:
    """Mean of (p − 1)² of (Q,) right answers and p² of wrong ones (Brier, Monthly Weather Review 78, 1950)."""
    return float(np.mean((p_right - right) ** 2))
