"""Areas under the risk–coverage curve: how much goes wrong as more and more answers are given, the surest first.

At coverage c, the share c of the queries is answered. The selective risk is the share of these answers that is wrong;
the generalised risk is the share of all queries that is answered wrongly (Traub et al., NeurIPS 2024,
arXiv 2407.01032). The second does not weigh the few surest answers more than all others. Queries of equal confidence
count as the mean over their orders.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from offradar_ros.lab.evaluation.metrics.recall_at_rejection import rejection_curve


def aurc(confidences: ArrayLike, right: ArrayLike) -> float:
    """Area under the selective risk over coverages 0 to 1: the mean share of wrong answers.

    Args:
        confidences: (N,) numbers, −∞ allowed.
        right: (N,) booleans.

    Returns:
        0 to 1, lower is better; NaN without queries. ValueError for a confidence that is NaN.
    """
    return 1.0 - rejection_curve(-np.asarray(confidences, np.float64), right).mean_recall(1.0)


def augrc(confidences: ArrayLike, right: ArrayLike) -> float:
    """Area under the generalised risk over coverages 0 to 1, with the arguments of `aurc`.

    It equals (1 − AUROC) a (1 − a) + (1 − a)² / 2, where a is the share of right answers and the AUROC that of the
    confidence for them. 0 to 0.5, lower is better; NaN without queries.
    """
    curve = rejection_curve(-np.asarray(confidences, np.float64), right)
    total = float(curve.kept[-1])
    wrong = curve.kept - curve.correct
    return float(np.diff(curve.kept) @ (wrong[1:] + wrong[:-1])) / (2.0 * total**2) if total > 0.0 else math.nan
