"""The vanilla auto-encoder's objective: the negative evidence lower bound, without any contrast."""

from __future__ import annotations

import torch

from offradar_ros.encoders.networks.vae import VaeNetwork, VaeOutput
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.lab.training.losses.prior_divergence import prior_divergence
from offradar_ros.lab.training.objective import Outputs, Views

PIXEL_DEVIATION = 0.1
"""Standard deviation of a pixel, as a share of full power: about that of averaged speckle."""


class VaeObjective:
    """L = (w_r Σ_p (x_p − x̂_p)² / 2·0.1² + w_k KL(N(μ, σ²) ‖ N(0, I))) / d, mean over the scans.

    With ``loss.reconstruction_weight`` and ``loss.kl_weight`` 1 this is the bound itself (up to a constant), in nats
    per dimension; the weight of KL increases from 0 over ``loss.kl_warmup_steps``.
    """

    def __init__(self, config: TrainingConfig) -> None:
        self.config = config.loss
        self.network = VaeNetwork(config.network)

    def outputs(self, images: torch.Tensor) -> VaeOutput:
        """The `VaeOutput` of images."""
        output: VaeOutput = self.network(images)
        return output

    def losses(self, outputs: Outputs, views: Views, step: int) -> dict[str, torch.Tensor]:  # noqa: ARG002
        """Terms ``kl`` and ``reconstruction``; the contrastive settings are not used."""
        config, dimension = self.config, self.network.config.dimension
        output = VaeOutput(*outputs)
        with torch.autocast(output.mu.device.type, enabled=False):
            errors = (output.reconstruction.float() - output.target.float()).square().sum(dim=(1, 2, 3))
            divergence = prior_divergence(output.mu.float(), output.log_variance.float(), config.free_nats)
            warmup = min(1.0, (step + 1) / config.kl_warmup_steps) if config.kl_warmup_steps else 1.0
            return {
                'kl': config.kl_weight * warmup * divergence / dimension,
                'reconstruction': config.reconstruction_weight * errors.mean() / (2.0 * PIXEL_DEVIATION**2 * dimension),
            }
