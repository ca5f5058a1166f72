"""A bound on the share of wrong answers whose errors are correlated within a stretch of road."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_STAKES = np.linspace(0.0, 1.0, 33)[1:-1]
"""Shares of the highest stake with which the capital stays positive."""


def clustered_upper_bound(answered: NDArray[np.int64], wrong: NDArray[np.int64], confidence: float) -> float:
    """Upper bound on the share of wrong answers, from (B,) answered scans and (B,) wrong answers of B clusters.

    Clusters are independent; the scans of one may depend on each other in any way. A bet against the hypothesis that
    the share is ρ gains from a cluster with fewer wrong answers than ρ·answered. Its capital after all of them is

        Π_b (1 − λ (wrong_b − ρ answered_b) / m),   m = max answered_b,   0 ≤ λ ≤ 1 / (1 − ρ),

    which is at most 1 on average if the share is ρ or more, for every λ and so for their mean: by Markov it reaches
    1 / (1 − confidence) with a chance of at most 1 − confidence. It grows with ρ, so the bound is the ρ where it gets
    there. Waudby-Smith and Ramdas, "Estimating means of bounded random variables by betting", arXiv 2010.09686 (2020).
    """
    kept = answered > 0
    if not kept.any():
        return 1.0
    scale = float(answered[kept].max())
    answers, mistakes = answered[kept] / scale, wrong[kept] / scale
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = (low + high) / 2.0
        if _capital(answers, mistakes, middle) >= 1.0 / (1.0 - confidence):
            high = middle
        else:
            low = middle
    return high


def _capital(answers: NDArray[np.float64], mistakes: NDArray[np.float64], rate: float) -> float:
    gains = 1.0 - np.outer(_STAKES / (1.0 - rate), mistakes - rate * answers)
    logs = np.sum(np.log(np.maximum(gains, np.finfo(np.float64).tiny)), axis=1)
    return float(np.mean(np.exp(np.minimum(logs, 700.0))))
