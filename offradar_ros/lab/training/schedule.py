"""The learning rate as a function of the step alone, so that a resumed run needs no state for it."""

from __future__ import annotations

import math

from offradar_ros.lab.training.config import OptimiserConfig

_FIRST = 1.0 / 25.0
"""First rate of one_cycle, as a share of the highest."""


def learning_rate(config: OptimiserConfig, step: int, steps: int) -> float:
    """Rate of `step`, 0 to `steps` − 1.

    ``constant``; ``cosine``, half a cosine wave from the highest rate to 0; ``one_cycle``, half a wave up during the
    share `warmup` of the steps and half a wave down to 0 (Smith and Topin, 2018).
    """
    highest = config.learning_rate
    if config.schedule == 'constant':
        return highest
    rising = config.warmup * steps if config.schedule == 'one_cycle' else 0.0
    if step < rising:
        return highest * (_FIRST + (1.0 - _FIRST) * _rise(step / rising))
    return highest * (1.0 - _rise((step - rising) / max(1.0, steps - rising)))


def _rise(share: float) -> float:
    return 0.5 * (1.0 - math.cos(math.pi * share))
