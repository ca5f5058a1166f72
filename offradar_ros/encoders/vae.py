"""The vanilla variational auto-encoder (Kingma and Welling, 2014) as a place descriptor. Needs torch."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from offradar_ros.encoders.feature_map import FeatureMap
from offradar_ros.encoders.network_config import REDUCTION, NetworkConfig

# The decoder doubles the feature map's side three times: it rebuilds 1/4 of the image's.
TARGET_REDUCTION = 4
DECODER_CHANNELS = (128, 64, 32, 16)
LOG_VARIANCE_LIMIT = 10.0


class VaeOutput(NamedTuple):
    """What the loss needs: N images, d dimensions, t = S / 4.

    Attributes:
        mu: (N, d) mean of the posterior.
        log_variance: (N, d) its log variance.
        target: (N, 1, t, t) the image in [0, 1], averaged over 4 × 4 pixels.
        reconstruction: (N, 1, t, t) the same as decoded from a sample of the posterior.
    """

    mu: torch.Tensor
    log_variance: torch.Tensor
    target: torch.Tensor
    reconstruction: torch.Tensor


class VaeNetwork(nn.Module):
    """Backbone, two heads and a decoder to the image; nothing is contrasted.

    What is rebuilt is the image itself, not the feature map: without a contrastive term a backbone that also chose its
    own target could make that target trivial. The image is averaged over 4 × 4 pixels (2 m at the paper's resolution),
    since what is finer is speckle, which no code of d numbers holds. The descriptor is μ, the variance σ².
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.features = FeatureMap(config)
        flat, side = self.features.flat, config.side_px // REDUCTION
        self.mu = nn.Linear(flat, config.dimension)
        self.log_variance = nn.Linear(flat, config.dimension)
        layers: list[nn.Module] = [
            nn.Linear(config.dimension, DECODER_CHANNELS[0] * side * side),
            nn.ReLU(inplace=True),
            nn.Unflatten(1, (DECODER_CHANNELS[0], side, side)),
        ]
        for inputs, outputs in itertools.pairwise(DECODER_CHANNELS):
            layers += [nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU(inplace=True)]
        layers.append(nn.Conv2d(DECODER_CHANNELS[-1], 1, 3, padding=1))
        self.decoder = nn.Sequential(*layers)
        # The posterior starts at the prior's variance, 1.
        nn.init.normal_(self.log_variance.weight, std=1e-3 / flat**0.5)
        nn.init.zeros_(self.log_variance.bias)

    def posterior(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """μ and log σ², both (N, d), of images (N, S, S)."""
        flat = self.features(images).flatten(1)
        return self.mu(flat), self.log_variance(flat).clamp(-LOG_VARIANCE_LIMIT, LOG_VARIANCE_LIMIT)

    def forward(self, images: torch.Tensor) -> VaeOutput:
        """Everything that training needs, of images (N, S, S); outside training μ stands for the sample."""
        mu, log_variance = self.posterior(images)
        z = mu + torch.exp(0.5 * log_variance) * torch.randn_like(mu) if self.training else mu
        target = functional.avg_pool2d(images.unsqueeze(1).to(torch.float32) / 255.0, TARGET_REDUCTION)
        return VaeOutput(mu, log_variance, target, self.decoder(z))

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """μ (N, d) and σ² (N, d) of images (N, S, S)."""
        mu, log_variance = self.posterior(images)
        return mu, log_variance.exp()
