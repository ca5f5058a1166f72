"""The vanilla variational auto-encoder (Kingma and Welling, 2014) as a place descriptor. Needs torch."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from offradar_ros.encoders.network_config import POLAR, NetworkConfig
from offradar_ros.encoders.networks.backbone import AzimuthSpectrum
from offradar_ros.encoders.networks.network import Network

TARGET_REDUCTION = 4
# The decoder doubles rows and columns three times.
DECODER_GROWTH = 8
DECODER_CHANNELS = (128, 64, 32, 16)
LOG_VARIANCE_LIMIT = 10.0


class VaeOutput(NamedTuple):
    """Input of the loss: N images, d dimensions.

    Attributes:
        mu: (N, d) mean of the posterior.
        log_variance: (N, d) its log variance.
        target: (N, 1, t, u) the image in [0, 1], averaged over 4 × 4 pixels, or its amplitudes over azimuth.
        reconstruction: (N, 1, t, u) the target as decoded from a sample of the posterior.
    """

    mu: torch.Tensor
    log_variance: torch.Tensor
    target: torch.Tensor
    reconstruction: torch.Tensor


class VaeNetwork(Network):
    """Backbone, two heads and a decoder to the image, without a contrastive loss.

    The decoder reconstructs the image, not the feature map: without a contrastive term the backbone could learn a
    trivial feature map. The image is averaged over 4 × 4 pixels (2 m at the paper's resolution): finer detail is
    speckle, which d values cannot encode. A rotation-invariant backbone cannot reconstruct a rotated image: for polar
    images the amplitudes over azimuth are reconstructed. The descriptor is μ, the variance σ².
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        flat = self.features.flat
        target_rows, target_columns = (length // TARGET_REDUCTION for length in config.image_shape)
        self.spectrum: AzimuthSpectrum | None = None
        if config.backbone in POLAR:
            self.spectrum = AzimuthSpectrum(target_rows, target_rows // 2 + 1)
            target_rows = target_rows // 2 + 1
        self._target_shape = (target_rows, target_columns)
        rows, columns = (-(-length // DECODER_GROWTH) for length in self._target_shape)
        self.mu = nn.Linear(flat, config.dimension)
        self.log_variance = nn.Linear(flat, config.dimension)
        layers: list[nn.Module] = [
            nn.Linear(config.dimension, DECODER_CHANNELS[0] * rows * columns),
            nn.ReLU(inplace=True),
            nn.Unflatten(1, (DECODER_CHANNELS[0], rows, columns)),
        ]
        for inputs, outputs in itertools.pairwise(DECODER_CHANNELS):
            layers += [nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1), nn.ReLU(inplace=True)]
        layers.append(nn.Conv2d(DECODER_CHANNELS[-1], 1, 3, padding=1))
        self.decoder = nn.Sequential(*layers)
        # The posterior starts at the prior's variance, 1.
        nn.init.normal_(self.log_variance.weight, std=1e-3 / flat**0.5)
        nn.init.zeros_(self.log_variance.bias)

    def posterior(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """μ and log σ², both (N, d), of images (N, H, W)."""
        flat = self.features(images).flatten(1)
        return self.mu(flat), self.log_variance(flat).clamp(-LOG_VARIANCE_LIMIT, LOG_VARIANCE_LIMIT)

    def forward(self, images: torch.Tensor) -> VaeOutput:
        """The output for training, of images (N, H, W); outside training the sample is μ."""
        mu, log_variance = self.posterior(images)
        z = mu + torch.exp(0.5 * log_variance) * torch.randn_like(mu) if self.training else mu
        target = functional.avg_pool2d(images.unsqueeze(1).to(torch.float32) / 255.0, TARGET_REDUCTION)
        if self.spectrum is not None:
            target = self.spectrum(target)
        rows, columns = self._target_shape
        return VaeOutput(mu, log_variance, target, self.decoder(z)[:, :, :rows, :columns])

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """μ (N, d) and σ² (N, d) of images (N, H, W)."""
        mu, log_variance = self.posterior(images)
        return mu, log_variance.exp()
