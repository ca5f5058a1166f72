"""NT-Xent (Chen et al., 2020) with a per-sample temperature: the uncertainty of a scan scales its logits."""

from __future__ import annotations

import torch
from torch.nn import functional

from offradar_ros.lab.training.losses.cosines import cosines, other_views


def nt_xent(
    points: torch.Tensor, uncertainties: torch.Tensor, temperature: float, answers: str = 'own'
) -> torch.Tensor:
    """Scalar loss of (2m, d) points, which are L2-normalised here, and their (2m,) uncertainties U > 0.

    L = −1/2m Σ_i log softmax_{j ≠ i}(cos(x_i, x_j) / (τ U_i)) at i', the other view of i. The loss of a scan that
    resembles scans of other places is least for a high U, that of a distinct scan for a low U; the prior keeps U near
    1. With U = 1 for all scans it is NT-Xent.

    `answers` selects U in the temperature: ``own``, as above; ``greater``, the greater U of the two views for both;
    ``worse``, as ``own``, but with gradients only for the greater U. A degraded view then does not raise the U of the
    clean view of the same place.
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
