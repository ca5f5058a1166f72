"""Conformal bounds: they hold on average for one more scan that is exchangeable with those counted."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def scans_for_quantile(reject_at_most: float) -> int:
    """Fewest scans with which a quantile below the largest U bounds the share rejected: ⌈1/α⌉ − 1."""
    return math.ceil(1.0 / reject_at_most - 1e-9) - 1


def conformal_quantile(uncertainties: NDArray[np.float64], reject_at_most: float) -> float:
    """The ⌈(n + 1)(1 − α)⌉-th smallest of (n,) U: one more scan's is above it with a chance of at most α.

    Vovk, Gammerman and Shafer, "Algorithmic Learning in a Random World" (2005). The largest, whose bound is 1/(n + 1),
    where n is below `scans_for_quantile`.
    """
    values = np.sort(uncertainties)
    rank = math.ceil((len(values) + 1) * (1.0 - reject_at_most) - 1e-9)
    return float(values[min(rank, len(values)) - 1])


def risk_bound(wrongly_answered: int, scans: int) -> float:
    """(k + 1)/(n + 1) for k wrongly answered of n scans, rejected ones included.

    One more scan is answered wrongly with a chance of at most α at the highest threshold where this is at most α, and
    at each below it, however it was chosen: a lower threshold answers no more. Angelopoulos et al., "Conformal risk
    control", arXiv 2208.02814 (2022).
    """
    return (wrongly_answered + 1) / (scans + 1)
