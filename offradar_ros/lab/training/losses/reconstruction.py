"""Reconstruction error of the feature map (eq. 4 of the paper)."""

from __future__ import annotations

import torch


def reconstruction_error(decoded: torch.Tensor, features: torch.Tensor, kind: str) -> torch.Tensor:
    """Scalar error of (N, …) decoded features: ``mse``, or ``l2``, the mean over N of the Euclidean norm per scan.

    `features` gets no gradient, because it would shrink the target.
    """
    difference = (decoded - features.detach()).flatten(1)
    if kind == 'mse':
        return difference.square().mean()
    norms: torch.Tensor = torch.linalg.vector_norm(difference, dim=1)
    return norms.mean()
