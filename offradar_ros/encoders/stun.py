"""STUN (Cai et al., IROS 2022): a student that says how far from its teacher it expects to be. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

from offradar_ros.encoders.feature_map import FeatureMap
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.unit_length import unit_length


class StunNetwork(nn.Module):
    """The student: backbone, a normalised mean and log s² between 0 and 1, as its authors' code has it.

    So s² lies between 1 and e for every scan. The teacher is a `BcRadarNetwork`, the same common loss and backbone.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.features = FeatureMap(config)
        self.head = nn.Linear(self.features.flat, config.dimension)
        self.log_variance = nn.Linear(self.features.flat, config.dimension)

    def forward(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit mean (N, d) and log s² (N, d) of images (N, H, W)."""
        flat = self.features(images).flatten(1)
        return unit_length(self.head(flat)), torch.sigmoid(self.log_variance(flat))

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit descriptor (N, d) and variance s² (N, d) of images (N, H, W)."""
        mean, log_variance = self(images)
        return mean, log_variance.exp()
