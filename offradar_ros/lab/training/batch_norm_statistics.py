"""Re-estimate the statistics of batch normalisation for trained weights."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import nn


def reestimate_batch_norm(network: nn.Module, batches: Iterable[torch.Tensor]) -> None:
    """Set the statistics of every batch normalisation to the means over `batches` of images.

    During training they are exponential moving averages of the last few batches, each from a few worlds and radars,
    and saved weights would favour those. Weights do not change. The network is left in evaluation mode.
    """
    momenta = {layer: layer.momentum for layer in network.modules() if isinstance(layer, nn.BatchNorm2d)}
    if momenta:
        network.train()
        for layer in momenta:
            layer.reset_running_stats()
            # A plain mean over all batches.
            layer.momentum = None
        with torch.inference_mode():
            for images in batches:
                network(images)
        for layer, momentum in momenta.items():
            layer.momentum = momentum
    network.eval()
