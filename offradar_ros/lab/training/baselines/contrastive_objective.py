"""BCRadar and MC Dropout: the common contrastive term on their embeddings alone."""

from __future__ import annotations

import torch

from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.baselines.common_contrast import common_contrast
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.lab.training.objective import Outputs, Views


class ContrastiveObjective:
    """L = w L_m(z), with criterion and weight of ``loss.invariant``; in training, dropout is applied to MC Dropout's z.

    Rotations and temporally near positives (Gadd et al., 2021) are settings of the batch.
    """

    def __init__(self, config: TrainingConfig) -> None:
        """ConfigError for a contrastive term of weight 0, because there is no other term."""
        self.config = config.loss.invariant
        if not self.config.weight:
            raise ConfigError(f'key loss.invariant.weight: {config.method} has no other term: expected more than 0')
        self.network = make_network(config.network)

    def outputs(self, images: torch.Tensor) -> Outputs:
        """The embedding alone."""
        return (self.network(images),)

    def losses(self, outputs: Outputs, views: Views, step: int) -> dict[str, torch.Tensor]:  # noqa: ARG002
        """Term ``contrast``."""
        (embedding,) = outputs
        with torch.autocast(views.images.device.type, enabled=False):
            return {'contrast': common_contrast(self.config, embedding.float())}
