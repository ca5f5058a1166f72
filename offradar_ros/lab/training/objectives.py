"""Every method by name."""

from __future__ import annotations

from collections.abc import Callable

from torch import nn

from offradar_ros.encoders.networks.bc_radar import BcRadarNetwork
from offradar_ros.encoders.networks.mc_dropout import McDropoutNetwork
from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.baselines.contrastive_objective import ContrastiveObjective
from offradar_ros.lab.training.baselines.stun_objective import StunObjective
from offradar_ros.lab.training.baselines.vae_objective import VaeObjective
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.lab.training.objective import Objective
from offradar_ros.lab.training.variational_objective import VariationalObjective

MakeObjective = Callable[[TrainingConfig, 'nn.Module | None'], Objective]

OBJECTIVES: dict[str, MakeObjective] = {
    'variational': lambda config, _teacher: VariationalObjective(config),
    'bc_radar': lambda config, _teacher: ContrastiveObjective(config, BcRadarNetwork(config.network)),
    'vae': lambda config, _teacher: VaeObjective(config),
    'mc_dropout': lambda config, _teacher: ContrastiveObjective(config, McDropoutNetwork(config.network)),
    'stun': StunObjective,
}
NEED_TEACHER = frozenset({'stun'})
"""Methods whose entry above is given a trained network of `TeacherConfig.method`."""


def make_objective(config: TrainingConfig, teacher: nn.Module | None = None) -> Objective:
    """The objective of `config.method`, with a network initialised from torch's seed; ConfigError for an unknown one.

    `teacher` is what a method of `NEED_TEACHER` learns from.
    """
    if config.method not in OBJECTIVES:
        raise ConfigError(f'key network.method: expected one of {", ".join(OBJECTIVES)}, got {config.method!r}')
    if config.method in NEED_TEACHER and teacher is None:
        raise ConfigError(f'method {config.method} learns from a teacher, and there is none')
    return OBJECTIVES[config.method](config, teacher)
