"""How far descriptors point away from those of a teacher."""

from __future__ import annotations

import torch
from torch.nn import functional


def angular_distance(points: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
    """Scalar mean of 1 − cos(x, t) over the rows of (N, d) points and targets; no gradient flows to the targets."""
    return 1.0 - functional.cosine_similarity(points, targets.detach(), dim=1).mean()
