"""The paper's network (Sec. III-A): an invariant embedding, a variational part and a decoder. Needs torch.

An image's feature map M feeds three parallel linear heads, Z_I, μ_V and log σ²; Z_V ~ N(μ_V, diag σ²) and
Z = Z_I + Z_V. The decoder reconstructs M from Z. As in deep variational metric learning (Lin et al., ECCV 2018) these
outputs are not normalised: the losses normalise them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import nn

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.l2_normalise import l2_normalise
from offradar_ros.encoders.networks.network import Network

# exp(±10) is finite when squared in float32, and calibrated variances are far from both limits.
LOG_VARIANCE_LIMIT = 10.0


class NetworkOutput(NamedTuple):
    """Input of the losses: N images, d dimensions, C channels of h × w features.

    Attributes:
        z_i: (N, d) invariant embedding.
        mu: (N, d) mean of the posterior of Z_V.
        log_variance: (N, d) its log variance.
        z: (N, d) Z_I plus a reparameterised sample of Z_V in training, else plus the mean of Z_V.
        features: (N, C, h, w) feature map M, detached: the target of the decoder.
        reconstruction: (N, C, h, w) reconstruction of M from Z.
    """

    z_i: torch.Tensor
    mu: torch.Tensor
    log_variance: torch.Tensor
    z: torch.Tensor
    features: torch.Tensor
    reconstruction: torch.Tensor


class VariationalNetwork(Network):
    """Backbone, heads and decoder; images are (N, H, W) uint8 or float power in 0…255."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        flat, channels = self.features.flat, self.features.shape[0]
        self.z_i = nn.Linear(flat, config.dimension)
        self.mu = nn.Linear(flat, config.dimension)
        self.log_variance = nn.Linear(flat, config.dimension)
        self.decoder = nn.Sequential(
            nn.Linear(config.dimension, flat),
            nn.ReLU(inplace=True),
            nn.Unflatten(1, self.features.shape),
            nn.Conv2d(channels, channels, 3, padding=1),
        )
        # The posterior starts at the prior's variance, 1.
        nn.init.normal_(self.log_variance.weight, std=1e-3 / flat**0.5)
        nn.init.zeros_(self.log_variance.bias)

    def log_variance_of(self, flat: torch.Tensor) -> torch.Tensor:
        """log σ² (N, d) of flattened feature maps (N, C · h · w)."""
        log_variance: torch.Tensor = self.log_variance(flat)
        return log_variance.clamp(-LOG_VARIANCE_LIMIT, LOG_VARIANCE_LIMIT)

    def descriptor_of(self, flat: torch.Tensor) -> torch.Tensor:
        """Unit descriptor (N, d) of flattened feature maps (N, C · h · w).

        The losses compare angles, and so does a search over unit vectors.
        """
        z_i = self.z_i(flat)
        return l2_normalise(z_i if self.config.descriptor == 'z_i' else z_i + self.mu(flat))

    def forward(self, images: torch.Tensor) -> NetworkOutput:
        """The output for training, of images (N, H, W)."""
        features = self.features(images)
        flat = features.flatten(1)
        z_i, mu, log_variance = self.z_i(flat), self.mu(flat), self.log_variance_of(flat)
        z = z_i + mu
        if self.training:
            z = z + torch.exp(0.5 * log_variance) * torch.randn_like(mu)
        return NetworkOutput(z_i, mu, log_variance, z, features.detach(), self.decoder(z))

    def scale_variance(self, factor: float) -> None:
        """Multiply every variance by `factor`, in place."""
        with torch.no_grad():
            self.log_variance.bias.add_(math.log(factor))

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit descriptor (N, d) and variance (N, d) of images (N, H, W), without sampling."""
        flat = self.features(images).flatten(1)
        return self.descriptor_of(flat), self.log_variance_of(flat).exp()


def uncertainty(log_variance: torch.Tensor) -> torch.Tensor:
    """U (N,), the mean variance, of log σ² (N, d)."""
    return log_variance.exp().mean(dim=1)
