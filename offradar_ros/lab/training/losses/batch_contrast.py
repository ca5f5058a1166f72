"""The batch criterion of Ye et al. (CVPR 2019, eq. 5–7), eq. 1 and 2 of the paper, for Z_I and for Z."""

from __future__ import annotations

import math

import torch

from offradar_ros.lab.training.losses.cosines import cosines, other_views

# Upper limit of P for log(1 − P): with ω < 1, P of a negative nearer than the other view may exceed 1.
_MAX_PROBABILITY = 1.0 - 1e-6


def batch_contrast(points: torch.Tensor, temperature: float, negative_weight: float) -> torch.Tensor:
    """Scalar loss of (2m, d) points, which are L2-normalised here.

    With s_ij = cos(x_i, x_j) / τ, i' the other view of i, ω the weight of the negatives and
    D_i = e^{s_ii'} + ω Σ_{k ∉ {i, i'}} e^{s_ik}:

    L = −1/2m Σ_i [ log(e^{s_ii'} / D_i) + ω Σ_{j ∉ {i, i'}} log(1 − e^{s_ij} / D_i) ].

    The "negative margin" of the paper is ω (0.1), with τ = 1. Gradients flow through both views of a pair, unlike in
    the published code, which detaches one of them.
    """
    similarity = cosines(points) / temperature
    count = len(points)
    rows = torch.arange(count, device=points.device)
    other = other_views(count, points.device)
    is_negative = torch.ones_like(similarity, dtype=torch.bool)
    is_negative[rows, rows] = False
    is_negative[rows, other] = False
    positive = similarity[rows, other]
    negatives = similarity[is_negative].view(count, count - 2)
    weight = math.log(negative_weight) if negative_weight else -math.inf
    total = torch.logsumexp(torch.cat([positive[:, None], negatives + weight], dim=1), dim=1)
    probabilities = torch.exp(negatives - total[:, None]).clamp(max=_MAX_PROBABILITY)
    terms = positive - total + negative_weight * torch.log1p(-probabilities).sum(dim=1)
    return -terms.mean()
