"""The objective of a learned method."""

from __future__ import annotations

import pkgutil

from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.registry import ENCODERS
from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.lab.training.objective import Objective


def needs_teacher(method: str) -> bool:
    """Whether a method is trained with a trained network of `TeacherConfig.method`."""
    return bool(ENCODERS[method].teacher)


def make_objective(config: TrainingConfig, teacher: Network | None = None) -> Objective:
    """The objective of `config.method`, with a network initialised from torch's seed.

    `teacher` is the trained network of a method that needs one; ConfigError if it is missing.
    """
    make = pkgutil.resolve_name(ENCODERS[config.method].objective)
    if not needs_teacher(config.method):
        objective: Objective = make(config)
    elif teacher is None:
        raise ConfigError(f'method {config.method} needs a teacher: expected one')
    else:
        objective = make(config, teacher)
    return objective
