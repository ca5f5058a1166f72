"""The batch criterion of Ye et al. (CVPR 2019, eq. 5–7), eq. 1 and 2 of the paper, for Z_I and for Z."""

from __future__ import annotations

import math

import torch

from offradar_ros.lab.training.losses.cosines import cosines, other_views

# P is cut off here for log(1 − P): with ω < 1 a negative nearer than the other view can pass 1.
_NEAREST_TO_ONE = 1.0 - 1e-6


def batch_contrast(points: torch.Tensor, temperature: float, negative_weight: float) -> torch.Tensor:
    """Scalar loss of (2m, d) points, which are normalised here.

    With s_ij = cos(x_i, x_j) / τ, i' the other view of i, ω the weight of the negatives and
    D_i = e^{s_ii'} + ω Σ_{k ∉ {i, i'}} e^{s_ik}:

    L = −1/2m Σ_i [ log(e^{s_ii'} / D_i) + ω Σ_{j ∉ {i, i'}} log(1 − e^{s_ij} / D_i) ].

    The paper's "negative margin" is ω (0.1) beside τ = 1. Unlike the published code, which detaches one side of each
    pair, gradients flow through both.
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
    mistaken = torch.exp(negatives - total[:, None]).clamp(max=_NEAREST_TO_ONE)
    terms = positive - total + negative_weight * torch.log1p(-mistaken).sum(dim=1)
    return -terms.mean()
