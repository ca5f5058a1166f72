"""MC Dropout (Gal and Ghahramani, 2016): the spread of an embedding under dropout. Needs torch."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.l2_normalise import l2_normalise
from offradar_ros.encoders.networks.network import Network

PASSES = 20
_MASK_SEED = 20


class McDropoutNetwork(Network):
    """Backbone, dropout and one linear head, evaluated in T = 20 passes with different masks.

    Dropout is between backbone and head only, so that the backbone runs once and the T passes are 20 small products.
    The T masks are drawn once and stored with the weights: the same scan always gives the same embedding, in torch and
    in ONNX, and all scans use the same masks.

    With unit embeddings z_1 … z_T and their mean z̄ the descriptor is z̄ / |z̄|, and the variance is the population
    variance over the passes times d, so that U = Σ_i var(z_i) = 1 − |z̄|²: 0 if the passes
    agree, near 1 if their directions are random.
    """

    masks: torch.Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config, pooled=True)
        self.head = nn.Linear(self.features.flat, config.dimension)
        drawn = torch.rand((PASSES, self.features.flat), generator=torch.Generator().manual_seed(_MASK_SEED))
        self.register_buffer('masks', drawn >= config.dropout)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, d) embedding before normalisation, of images (N, H, W); with random dropout in training."""
        flat = functional.dropout(self.features(images).flatten(1), self.config.dropout, self.training)
        embedding: torch.Tensor = self.head(flat)
        return embedding

    def passes(self, images: torch.Tensor) -> torch.Tensor:
        """(N, T, d) unit embeddings of the fixed masks."""
        flat = self.features(images).flatten(1)
        dropped = flat.unsqueeze(1) * (self.masks.to(flat.dtype) / (1.0 - self.config.dropout))
        return l2_normalise(self.head(dropped))

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Unit descriptor (N, d) and variance (N, d) of images (N, H, W)."""
        passes = self.passes(images)
        mean = passes.mean(dim=1)
        variance = (passes - mean.unsqueeze(1)).square().mean(dim=1) * self.config.dimension
        return l2_normalise(mean), variance
