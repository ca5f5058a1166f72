"""Pairwise ranking loss: of two scans, the one with the higher target, such as severity, should have the higher U."""

from __future__ import annotations

import torch
from torch.nn import functional


def pairwise_ranking(uncertainties: torch.Tensor, targets: torch.Tensor, margin: float) -> torch.Tensor:
    """Scalar loss of (N,) U > 0 and (N,) targets t in any unit, NaN where unknown.

    L = Σ (t_i − t_j) softplus((log U_j − log U_i) / margin) / Σ (t_i − t_j) over pairs with t_i > t_j: the logistic
    pairwise loss (Burges et al., 2005), weighted by the difference of the targets. 0 without such a pair.
    """
    weights = torch.nan_to_num(targets[:, None] - targets[None, :], nan=0.0).clamp(min=0.0)
    levels = uncertainties.log()
    losses = functional.softplus((levels[None, :] - levels[:, None]) / margin)
    return (weights * losses).sum() / weights.sum().clamp(min=1e-6)
