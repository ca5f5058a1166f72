"""The common part of the learned methods: the backbone, and the flat features for the heads. Needs torch."""

from __future__ import annotations

import math

import torch
from torch import nn

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.backbone import make_backbone
from offradar_ros.encoders.networks.resnet50 import GeneralisedMean


class FeatureMap(nn.Module):
    """Images (N, H, W) of power 0…255, uint8 or float → the backbone's feature map (N, C, h, w).

    With `pooled` the map of ResNet-50 is pooled, as in STUN, for methods that do not reconstruct the map. `shape` is
    (C, h, w) and `flat` its product, the number of input features of a head.
    """

    def __init__(self, config: NetworkConfig, pooled: bool = False) -> None:
        super().__init__()
        self.backbone = make_backbone(config)
        self.shape = self.backbone.shape
        self.pool: GeneralisedMean | None = None
        if pooled and config.backbone == 'resnet50':
            self.pool, self.shape = GeneralisedMean(), (self.shape[0], 1, 1)
        self.flat = math.prod(self.shape)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, H, W) → (N, C, h, w)."""
        features: torch.Tensor = self.backbone(images.unsqueeze(1).to(torch.float32) / 255.0)
        return features if self.pool is None else self.pool(features)
