"""Sparsification (Ilg et al., ECCV 2018): how the error rate falls as the most uncertain queries are removed.

The error rate is error(r) = 1 − Recall@RR(r). An oracle removes the wrong answers first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from offradar_ros.lab.evaluation.metrics.recall_at_rejection import rejection_curve


def sparsification_area(uncertainties: ArrayLike, correct: ArrayLike) -> float:
    """AUSC, the area under the error rate over rejected shares 0 to 1: 0 is best; NaN without queries."""
    return 1.0 - rejection_curve(uncertainties, correct).mean_recall(1.0)


def sparsification_error(uncertainties: ArrayLike, correct: ArrayLike) -> float:
    """AUSE, that area minus the oracle's: the loss from ranking errors imperfectly, whatever the recall."""
    oracle = sparsification_area(~np.asarray(correct, np.bool_), correct)
    return sparsification_area(uncertainties, correct) - oracle
