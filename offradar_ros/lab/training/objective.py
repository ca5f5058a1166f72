"""What is minimised: the one interface between the training loop and a method."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch

from offradar_ros.encoders.networks.network import Network


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
    def network(self) -> Network:
        """What is trained and saved. All of its parameters go to the optimiser.

        The loop moves it to the device and switches it between training and evaluation; what else an objective holds
        (a frozen teacher) it moves by itself, to the device of the images.
        """

    def losses(self, views: Views, step: int) -> dict[str, torch.Tensor]:
        """Weighted scalar terms, named for the log, whose sum is minimised.

        `step` counts from 0 over the whole run. The loop calls this under autocast where mixed precision is asked for.
        """
