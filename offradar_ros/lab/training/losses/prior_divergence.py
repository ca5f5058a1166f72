"""KL divergence of the posteriors from the prior (eq. 3 of the paper, in closed form)."""

from __future__ import annotations

import torch


def prior_divergence(mu: torch.Tensor, log_variance: torch.Tensor, free_nats: float = 0.0) -> torch.Tensor:
    """KL(N(μ, diag σ²) ‖ N(0, I)) of (N, d) posteriors: summed over d, mean over N.

    KL_d = −½ (1 + log σ_d² − μ_d² − σ_d²). A dimension whose mean over the batch is below `free_nats` counts as
    `free_nats`, and then has no gradient.
    """
    divergence = 0.5 * (mu.square() + log_variance.exp() - 1.0 - log_variance)
    return divergence.mean(dim=0).clamp(min=free_nats).sum()
