"""The contrastive term that all metric-learning methods have in common (Sec. IV-B of the paper)."""

from __future__ import annotations

import torch

from offradar_ros.lab.training.config import ContrastConfig
from offradar_ros.lab.training.losses.batch_contrast import batch_contrast
from offradar_ros.lab.training.losses.nt_xent import nt_xent


def common_contrast(config: ContrastConfig, points: torch.Tensor) -> torch.Tensor:
    """Weighted scalar loss of (2m, d) embeddings without a variance, by the criterion that ours is trained with.

    The criteria that use a variance become, for one that is 1 or 0 everywhere, NT-Xent.
    """
    if config.criterion == 'batch':
        return config.weight * batch_contrast(points, config.temperature, config.negative_weight)
    return config.weight * nt_xent(points, points.new_ones(len(points)), config.temperature)
