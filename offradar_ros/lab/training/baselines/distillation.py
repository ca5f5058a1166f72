"""STUN's distillation losses (Cai et al., IROS 2022)."""

from __future__ import annotations

import torch


def distillation(student: torch.Tensor, log_variance: torch.Tensor, teacher: torch.Tensor) -> torch.Tensor:
    """Scalar loss of the student's means and log s² and the teacher's means, all (N, d), as in the authors' code.

    L = mean over scans and dimensions of ‖μ_s − μ_t‖₂ / s² + log s²; the norm is of the whole row and not squared. No
    gradient flows to the teacher.
    """
    distance = torch.linalg.vector_norm(student - teacher.detach(), dim=1, keepdim=True)
    loss: torch.Tensor = (distance * torch.exp(-log_variance) + log_variance).mean()
    return loss


def gaussian_distillation(student: torch.Tensor, log_variance: torch.Tensor, teacher: torch.Tensor) -> torch.Tensor:
    """The loss with a Gaussian in each dimension, as in the equation of the paper, for unbounded variances.

    L = ½ · mean over scans and dimensions of (μ_s − μ_t)² / s² + log s².
    """
    errors = (student - teacher.detach()).square()
    loss: torch.Tensor = 0.5 * (errors * torch.exp(-log_variance) + log_variance).mean()
    return loss
