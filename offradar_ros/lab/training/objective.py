"""What is minimised: the one interface between the training loop and a method."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch
from torch import nn

from offradar_ros.encoders.network_config import NetworkConfig


class EmbeddingNetwork(Protocol):
    """What the loop needs of an objective's network beside being a `torch.nn.Module`."""

    config: NetworkConfig

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Descriptor (N, d) and variance (N, d) of images (N, H, W) uint8, as the encoder made of it gives them."""


class Views(NamedTuple):
    """A batch; rows i and i + m are one place, every other pair of rows is of two.

    Attributes:
        images: (2m, H, W) uint8.
        severities: (2m,) float32, how badly each is degraded, 0 to 1, NaN where that is not known.
    """

    images: torch.Tensor
    severities: torch.Tensor


class Objective(Protocol):
    """A method's network and its losses."""

    @property
    def network(self) -> nn.Module:
        """What is trained, and saved: an `EmbeddingNetwork`. All of its parameters go to the optimiser.

        The loop moves it to the device and switches it between training and evaluation; what else an objective holds
        (a frozen teacher) it moves by itself, to the device of the images.
        """

    def losses(self, views: Views, step: int) -> dict[str, torch.Tensor]:
        """Weighted scalar terms, named for the log, whose sum is minimised.

        `step` counts from 0 over the whole run. The loop calls this under autocast where mixed precision is asked for.
        """
