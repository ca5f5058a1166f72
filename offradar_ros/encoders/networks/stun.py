"""STUN (Cai et al., IROS 2022): a student that predicts its deviation from the teacher. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.l2_normalise import l2_normalise
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.variational import LOG_VARIANCE_LIMIT


class StunNetwork(Network):
    """The student: backbone, a normalised mean and log s². The teacher is a `BcRadarNetwork` of the same backbone.

    ``bounded``: log s² is between 0 and 1, as in its authors' code, so that s² is between 1 and e for every scan.
    Distances between unit vectors are mostly smaller. ``free``: log s² is between −10 and 10.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config, pooled=True)
        self.head = nn.Linear(self.features.flat, config.dimension)
        self.log_variance = nn.Linear(self.features.flat, config.dimension)

    def forward(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit mean (N, d) and log s² (N, d) of images (N, H, W)."""
        flat = self.features(images).flatten(1)
        log_variance = self.log_variance(flat)
        if self.config.student == 'free':
            log_variance = log_variance.clamp(-LOG_VARIANCE_LIMIT, LOG_VARIANCE_LIMIT)
        else:
            log_variance = torch.sigmoid(log_variance)
        return l2_normalise(self.head(flat)), log_variance

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit descriptor (N, d) and variance s² (N, d) of images (N, H, W)."""
        mean, log_variance = self(images)
        return mean, log_variance.exp()
