"""The interface between the training loop and a method."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch

from offradar_ros.encoders.networks.network import Network

Outputs = tuple[torch.Tensor, ...]
"""What a network's losses are computed from: float tensors with one row per image."""


class Views(NamedTuple):
    """A batch; rows i and i + m are of the same place, all other pairs of rows of two places.

    Attributes:
        images: (2m, H, W) uint8.
        severities: (2m,) float32, severity of degradation, 0 to 1, NaN where unknown.
        targets: (2m, 2, d) float32, descriptor and log variance that a teacher gives to each scan; None without one.
    """

    images: torch.Tensor
    severities: torch.Tensor
    targets: torch.Tensor | None = None


class Objective(Protocol):
    """A method's network and its losses."""

    @property
    def network(self) -> Network:
        """The network that is trained and saved; all of its parameters are optimised.

        The loop moves it to the device and switches it between training and evaluation mode. An objective moves other
        modules (a frozen teacher) to the device of the images by itself.
        """

    def outputs(self, images: torch.Tensor) -> Outputs:
        """The outputs of the network for (N, H, W) uint8 images, of a whole batch or of a part of one.

        With mixed precision the loop calls this, and `losses`, under autocast.
        """

    def losses(self, outputs: Outputs, views: Views, step: int) -> dict[str, torch.Tensor]:
        """Weighted scalar terms of the outputs of a whole batch, with their names in the log; their sum is minimised.

        `step` counts from 0 over the whole run.
        """


def losses_of(objective: Objective, views: Views, step: int) -> dict[str, torch.Tensor]:
    """The terms of a batch that passes the network at once."""
    return objective.losses(objective.outputs(views.images), views, step)


def total_of(terms: dict[str, torch.Tensor]) -> torch.Tensor:
    """The sum of the terms, which is minimised."""
    return torch.stack(list(terms.values())).sum()
