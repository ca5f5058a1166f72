"""The paper's objective (Sec. III-A) and ours: two contrastive terms, a prior, a decoder, and a ranking of U."""

from __future__ import annotations

import torch

from offradar_ros.encoders.networks.variational import NetworkOutput, VariationalNetwork, uncertainty
from offradar_ros.lab.training.config import ContrastConfig, TrainingConfig
from offradar_ros.lab.training.losses.batch_contrast import batch_contrast
from offradar_ros.lab.training.losses.hedged_contrast import hedged_contrast
from offradar_ros.lab.training.losses.nt_xent import nt_xent
from offradar_ros.lab.training.losses.pairwise_ranking import pairwise_ranking
from offradar_ros.lab.training.losses.prior_divergence import prior_divergence
from offradar_ros.lab.training.losses.reconstruction import reconstruction_error
from offradar_ros.lab.training.objective import Views


class VariationalObjective:
    """L = w₁ L_m(Z_I) + w₂ L_m(Z) + w₃ KL + w₄ L_rec, with the criteria and weights of `LossConfig`.

    A fifth term, which the paper does not have, ranks U by severity where that is known.
    """

    def __init__(self, config: TrainingConfig) -> None:
        self.config = config.loss
        self.network = VariationalNetwork(config.network)

    def losses(self, views: Views, step: int) -> dict[str, torch.Tensor]:
        """Terms ``invariant``, ``variant``, ``severity``, ``kl`` and ``reconstruction``, without those of weight 0."""
        config = self.config
        mixed = self.network(views.images)
        with torch.autocast(views.images.device.type, enabled=False):
            output = NetworkOutput(*(part.float() for part in mixed))
            terms: dict[str, torch.Tensor] = {}
            for name, contrast in (('invariant', config.invariant), ('variant', config.variant)):
                if contrast.weight:
                    terms[name] = contrast.weight * _contrast(contrast, output)
            if config.severity.weight:
                ranking = pairwise_ranking(uncertainty(output.log_variance), views.severities, config.severity.margin)
                terms['severity'] = config.severity.weight * ranking
            if config.kl_weight:
                warmup = min(1.0, (step + 1) / config.kl_warmup_steps) if config.kl_warmup_steps else 1.0
                divergence = prior_divergence(output.mu, output.log_variance, config.free_nats)
                terms['kl'] = config.kl_weight * warmup * divergence
            if config.reconstruction_weight:
                error = reconstruction_error(output.reconstruction, output.features, config.reconstruction)
                terms['reconstruction'] = config.reconstruction_weight * error
        return terms


def _contrast(config: ContrastConfig, output: NetworkOutput) -> torch.Tensor:
    if config.criterion == 'hedged':
        centre = output.z_i if config.on == 'z_i' else output.z_i + output.mu
        return hedged_contrast(centre, output.log_variance, config.temperature, config.samples)
    points = {'z_i': output.z_i, 'mean': output.z_i + output.mu, 'z': output.z}[config.on]
    if config.criterion == 'batch':
        return batch_contrast(points, config.temperature, config.negative_weight)
    return nt_xent(points, uncertainty(output.log_variance), config.temperature, config.answers)
