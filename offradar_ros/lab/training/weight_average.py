"""An exponential moving average of a network's weights over the steps."""

from __future__ import annotations

import copy

import torch

from offradar_ros.encoders.networks.network import Network


class WeightAverage:
    """w̄ ← β w̄ + (1 − β) w after each step: weights with less of the noise of the last batches.

    β of step t is min(decay, (1 + t) / (10 + t)), so that the random initial weights are soon forgotten. It depends on
    the step alone: a resumed run needs the averages and nothing more. Buffers (batch statistics) are those of the
    network after the last step.
    """

    def __init__(self, network: Network, decay: float) -> None:
        self.network = copy.deepcopy(network).requires_grad_(False)
        self._decay = decay

    def update(self, network: Network, step: int) -> None:
        """Take in the weights of `network` after `step`, which counts from 0."""
        share = 1.0 - min(self._decay, (1.0 + step) / (10.0 + step))
        with torch.no_grad():
            for mean, weight in zip(self.network.parameters(), network.parameters(), strict=True):
                mean.lerp_(weight, share)
            for mine, buffer in zip(self.network.buffers(), network.buffers(), strict=True):
                mine.copy_(buffer)
