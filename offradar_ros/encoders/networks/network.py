"""The base class of the networks of learned methods. Needs torch."""

from __future__ import annotations

import abc

import torch
from torch import nn

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.feature_map import FeatureMap


class Network(nn.Module, abc.ABC):
    """A backbone, and in subclasses the heads of a method; encoders call `embed` only."""

    def __init__(self, config: NetworkConfig, pooled: bool = False) -> None:
        """`pooled` as in `FeatureMap`."""
        super().__init__()
        self.config = config
        self.features = FeatureMap(config, pooled)

    @abc.abstractmethod
    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Descriptor (N, d) and variance (N, d) of images (N, H, W) of power 0…255, uint8 or float."""
