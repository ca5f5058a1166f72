"""The objective of a learned method."""

from __future__ import annotations

import pkgutil

from torch import nn

from offradar_ros.encoders.registry import ENCODERS
from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.lab.training.objective import Objective


def needs_teacher(method: str) -> bool:
    """Whether a learned method learns from a trained network of `TeacherConfig.method`."""
    return bool(ENCODERS[method].teacher)


def make_objective(config: TrainingConfig, teacher: nn.Module | None = None) -> Objective:
    """The objective of `config.method`, with a network initialised from torch's seed.

    `teacher` is what a method that needs one learns from; ConfigError where there is none.
    """
    make = pkgutil.resolve_name(ENCODERS[config.method].objective)
    if not needs_teacher(config.method):
        objective: Objective = make(config)
    elif teacher is None:
        raise ConfigError(f'method {config.method} learns from a teacher, and there is none')
    else:
        objective = make(config, teacher)
    return objective
