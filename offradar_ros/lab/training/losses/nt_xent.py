"""NT-Xent (Chen et al., 2020) with a per-sample temperature: each scan's uncertainty scales its own logits."""

from __future__ import annotations

import torch
from torch.nn import functional

from offradar_ros.lab.training.losses.cosines import cosines, other_views


def nt_xent(
    points: torch.Tensor, uncertainties: torch.Tensor, temperature: float, answers: str = 'own'
) -> torch.Tensor:
    """Scalar loss of (2m, d) points, which are normalised here, and their (2m,) uncertainties U > 0.

    L = −1/2m Σ_i log softmax_{j ≠ i}(cos(x_i, x_j) / (τ U_i)) at i', the other view of i. The loss of a scan that
    resembles those of other places is least with a high U, that of a distinct one with a low U; the prior keeps U near
    1. With U = 1 everywhere it is NT-Xent.

    `answers` says whose U the temperature of a pair is: ``own``, as above; ``greater``, that of the more uncertain view
    for both; ``worse``, as ``own``, but only the more uncertain view's U learns from it. A clean scan beside a
    degraded one is then not made uncertain by what is wrong with the other.
    """
    count = len(points)
    others = other_views(count, points.device)
    if answers == 'greater':
        uncertainties = torch.maximum(uncertainties, uncertainties[others])
    elif answers == 'worse':
        is_worse = uncertainties >= uncertainties[others]
        uncertainties = torch.where(is_worse, uncertainties, uncertainties.detach())
    logits = cosines(points) / (temperature * uncertainties[:, None])
    itself = torch.eye(count, dtype=torch.bool, device=points.device)
    return functional.cross_entropy(logits.masked_fill(itself, -torch.inf), others)
