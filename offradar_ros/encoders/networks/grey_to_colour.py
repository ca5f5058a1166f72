"""Grey images as input of backbones for colour images. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


class GreyToColour(nn.Module):
    """(N, 1, S, S) in [0, 1] → (N, 3, S, S), normalised with ImageNet's statistics, for pretrained weights."""

    pixel_mean: torch.Tensor
    pixel_std: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer('pixel_mean', torch.tensor(IMAGENET_MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer('pixel_std', torch.tensor(IMAGENET_STD).view(1, 3, 1, 1), persistent=False)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, 1, S, S) → (N, 3, S, S)."""
        return (image.expand(-1, 3, -1, -1) - self.pixel_mean) / self.pixel_std
