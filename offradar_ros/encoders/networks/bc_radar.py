"""BCRadar (Gadd et al., 2021): a deterministic embedding, trained with the batch criterion. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.l2_normalise import l2_normalise
from offradar_ros.encoders.networks.network import Network


class BcRadarNetwork(Network):
    """Backbone and one linear head with L2-normalised output, because the batch criterion compares cosines.

    It defines no uncertainty. Its variance is 1, the prior's, for every scan: thresholds of 1 and above reject no scan,
    and Algorithm 1 never replaces a place.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config, pooled=True)
        self.head = nn.Linear(self.features.flat, config.dimension)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, d) embedding before normalisation, of images (N, H, W)."""
        embedding: torch.Tensor = self.head(self.features(images).flatten(1))
        return embedding

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit descriptor (N, d) and variance (N, d), all 1, of images (N, H, W)."""
        descriptor = l2_normalise(self(images))
        return descriptor, torch.ones_like(descriptor)
