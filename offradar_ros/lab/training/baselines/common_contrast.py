"""The contrastive term of all metric-learning methods (Sec. IV-B of the paper)."""

from __future__ import annotations

import torch

from offradar_ros.lab.training.config import ContrastConfig
from offradar_ros.lab.training.losses.batch_contrast import batch_contrast
from offradar_ros.lab.training.losses.nt_xent import nt_xent


def common_contrast(config: ContrastConfig, points: torch.Tensor) -> torch.Tensor:
    """Weighted scalar loss of (2m, d) embeddings without a variance, with the criterion of our method.

    The criteria with a variance reduce to NT-Xent: for U = 1 (temperature) and for a variance of 0 (hedged).
    """
    if config.criterion == 'batch':
        return config.weight * batch_contrast(points, config.temperature, config.negative_weight)
    return config.weight * nt_xent(points, points.new_ones(len(points)), config.temperature)
