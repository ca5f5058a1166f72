"""Cosine similarities of a batch, for the contrastive losses."""

from __future__ import annotations

import torch
from torch.nn import functional


def cosines(points: torch.Tensor) -> torch.Tensor:
    """(N, N) cosine of every pair of the (N, d) rows; a row of zeros is orthogonal to all."""
    unit = functional.normalize(points, dim=1)
    return unit @ unit.T


def other_views(count: int, device: torch.device) -> torch.Tensor:
    """(N,) int64, for each of N = 2m rows the row of the other view of its place; ValueError for N odd or below 4."""
    if count % 2 or count < 4:
        raise ValueError(f'expected two views each of two places or more, got {count} rows')
    return torch.arange(count, device=device).roll(count // 2)
