"""Which answers are given where they are to have a wanted precision."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from offradar_ros.lab.evaluation.metrics.precision_recall import precision_recall


def accepted_at_precision(confidences: ArrayLike, right: ArrayLike, precision: float) -> NDArray[np.bool_]:
    """The answers whose confidence is at least the lowest threshold at which this share of the answers is right.

    Args:
        confidences: (N,) numbers; −∞ is never accepted, equal ones are accepted together.
        right: (N,) booleans.
        precision: the share of right answers that is wanted, above 0.

    Returns:
        (N,) bool; all false if no threshold gives this precision. ValueError for a confidence that is NaN.
    """
    scores = -np.asarray(confidences, np.float64)
    curve = precision_recall(scores, right)
    enough = np.flatnonzero(curve.precision >= precision)
    if not len(enough):
        return np.zeros(len(scores), np.bool_)
    accepted: NDArray[np.bool_] = scores <= curve.thresholds[enough[-1]]
    return accepted
