"""STUN's distillation loss (Cai et al., IROS 2022, as their code has it)."""

from __future__ import annotations

import torch


def distillation(student: torch.Tensor, log_variance: torch.Tensor, teacher: torch.Tensor) -> torch.Tensor:
    """Scalar loss of the student's means and log s² and the teacher's means, all (N, d).

    L = mean over scans and dimensions of ‖μ_s − μ_t‖₂ / s² + log s²; the norm is of the whole row and not squared. No
    gradient flows to the teacher.
    """
    distance = torch.linalg.vector_norm(student - teacher.detach(), dim=1, keepdim=True)
    loss: torch.Tensor = (distance * torch.exp(-log_variance) + log_variance).mean()
    return loss
