"""The interface between the training loop and a method."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch

from offradar_ros.encoders.networks.network import Network


class Views(NamedTuple):
    """A batch; rows i and i + m are of the same place, all other pairs of rows of two places.

    Attributes:
        images: (2m, H, W) uint8.
        severities: (2m,) float32, severity of degradation, 0 to 1, NaN where unknown.
    """

    images: torch.Tensor
    severities: torch.Tensor


class Objective(Protocol):
    """A method's network and its losses."""

    @property
    def network(self) -> Network:
        """The network that is trained and saved; all of its parameters are optimised.

        The loop moves it to the device and switches it between training and evaluation mode. An objective moves other
        modules (a frozen teacher) to the device of the images by itself.
        """

    def losses(self, views: Views, step: int) -> dict[str, torch.Tensor]:
        """Weighted scalar terms, with their names in the log; their sum is minimised.

        `step` counts from 0 over the whole run. With mixed precision the loop calls this under autocast.
        """
