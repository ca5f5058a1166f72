"""STUN: a student is trained to give the embedding of a trained teacher, and the expected distance to it."""

from __future__ import annotations

import torch

from offradar_ros.encoders.networks.bc_radar import BcRadarNetwork
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.stun import StunNetwork
from offradar_ros.errors import ModelError
from offradar_ros.lab.training.baselines.distillation import distillation, gaussian_distillation
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.lab.training.objective import Outputs, Views


class StunObjective:
    """The network of the student, and a frozen teacher.

    The student starts from random weights, as in its authors' code, or, with ``teacher.student: teacher``, from the
    teacher's backbone and head, as "finetuned" in the paper suggests; its uncertainty is then lower.
    """

    def __init__(self, config: TrainingConfig, teacher: Network | None) -> None:
        """ModelError for a teacher that is no `BcRadarNetwork` or has another dimension or image (and so backbone)."""
        if not isinstance(teacher, BcRadarNetwork):
            raise ModelError(f'teacher: expected a trained bc_radar network, got {type(teacher).__name__}')
        self.network = StunNetwork(config.network)
        for name in ('dimension', 'image'):
            expected, found = getattr(config.network, name), getattr(teacher.config, name)
            if expected != found:
                raise ModelError(f"teacher: expected the student's {name} = {expected}, got {found}")
        if config.teacher.student == 'teacher':
            self.network.features.load_state_dict(teacher.features.state_dict())
            self.network.head.load_state_dict(teacher.head.state_dict())
        self.teacher = teacher.eval().requires_grad_(False)

    def outputs(self, images: torch.Tensor) -> Outputs:
        """Mean and log s² of the student, and the teacher's mean, without a graph."""
        self.teacher.to(images.device)
        with torch.no_grad():
            target, _ = self.teacher.embed(images)
        mean, log_variance = self.network(images)
        return mean, log_variance, target

    def losses(self, outputs: Outputs, views: Views, step: int) -> dict[str, torch.Tensor]:  # noqa: ARG002
        """Term ``distillation``."""
        mean, log_variance, target = outputs
        loss = gaussian_distillation if self.network.config.student == 'free' else distillation
        with torch.autocast(views.images.device.type, enabled=False):
            return {'distillation': loss(mean.float(), log_variance.float(), target.float())}
