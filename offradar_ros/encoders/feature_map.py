"""What every learned method has in common: the backbone and the flat features that its heads see. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

from offradar_ros.encoders.backbone import make_backbone
from offradar_ros.encoders.network_config import REDUCTION, NetworkConfig


class FeatureMap(nn.Module):
    """Images (N, S, S) of power 0…255, uint8 or float → the backbone's feature map (N, C, s, s).

    `shape` is (C, s, s) and `flat` its product, the number of features that a head sees.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.backbone = make_backbone(config.backbone)
        side = config.side_px // REDUCTION
        self.shape = (self.backbone.channels, side, side)
        self.flat = self.backbone.channels * side * side

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, S, S) → (N, C, s, s)."""
        features: torch.Tensor = self.backbone(images.unsqueeze(1).to(torch.float32) / 255.0)
        return features
