"""The paper's objective (Sec. III-A) and ours: two contrastive terms, a prior, a decoder, a ranking of U, a teacher."""

from __future__ import annotations

import torch
from torch.nn import functional

from offradar_ros.encoders.networks.variational import NetworkOutput, VariationalNetwork, uncertainty
from offradar_ros.lab.training.config import ContrastConfig, TrainingConfig
from offradar_ros.lab.training.losses.angular_distance import angular_distance
from offradar_ros.lab.training.losses.batch_contrast import batch_contrast
from offradar_ros.lab.training.losses.hedged_contrast import hedged_contrast
from offradar_ros.lab.training.losses.nt_xent import nt_xent
from offradar_ros.lab.training.losses.pairwise_ranking import pairwise_ranking
from offradar_ros.lab.training.losses.prior_divergence import prior_divergence
from offradar_ros.lab.training.losses.reconstruction import reconstruction_error
from offradar_ros.lab.training.objective import Outputs, Views


class VariationalObjective:
    """L = w₁ L_m(Z_I) + w₂ L_m(Z) + w₃ KL + w₄ L_rec, with the criteria and weights of `LossConfig`.

    A fifth term, which the paper does not have, ranks U by severity where that is known; two more pull the embedding
    to a teacher's.
    """

    def __init__(self, config: TrainingConfig) -> None:
        self.config = config.loss
        self.distillation = config.distillation
        self.network = VariationalNetwork(config.network)

    def outputs(self, images: torch.Tensor) -> NetworkOutput:
        """The `NetworkOutput` of images."""
        output: NetworkOutput = self.network(images)
        return output

    def losses(self, outputs: Outputs, views: Views, step: int) -> dict[str, torch.Tensor]:
        """Terms without those of weight 0.

        They are ``invariant``, ``variant``, ``severity``, ``kl``, ``reconstruction`` and, with targets in `views`,
        ``distilled_descriptor`` and ``distilled_variance``.
        """
        config = self.config
        with torch.autocast(views.images.device.type, enabled=False):
            output = NetworkOutput(*(part.float() for part in outputs))
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
            if views.targets is not None:
                terms |= self._distilled(output, views.targets)
        return terms

    def _distilled(self, output: NetworkOutput, targets: torch.Tensor) -> dict[str, torch.Tensor]:
        config, (descriptors, log_variances) = self.distillation, targets.unbind(dim=1)
        terms: dict[str, torch.Tensor] = {}
        if config.descriptor_weight:
            points = output.z_i if self.network.config.descriptor == 'z_i' else output.z_i + output.mu
            terms['distilled_descriptor'] = config.descriptor_weight * angular_distance(points, descriptors)
        if config.variance_weight:
            error = functional.mse_loss(output.log_variance, log_variances)
            terms['distilled_variance'] = config.variance_weight * error
        return terms


def _contrast(config: ContrastConfig, output: NetworkOutput) -> torch.Tensor:
    if config.criterion == 'hedged':
        centre = output.z_i if config.on == 'z_i' else output.z_i + output.mu
        return hedged_contrast(centre, output.log_variance, config.temperature, config.samples)
    points = {'z_i': output.z_i, 'mean': output.z_i + output.mu, 'z': output.z}[config.on]
    if config.criterion == 'batch':
        return batch_contrast(points, config.temperature, config.negative_weight)
    return nt_xent(points, uncertainty(output.log_variance), config.temperature, config.answers)
