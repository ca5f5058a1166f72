"""ResNet-50 (He et al., 2016), the backbone of STUN, and the pooling that follows it there. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

from offradar_ros.encoders.network_config import CARTESIAN_REDUCTION
from offradar_ros.encoders.networks.grey_to_colour import GreyToColour

# Blocks and inner channels of each group; all but the first start with a stride of 2.
RESNET50_GROUPS = ((3, 64), (4, 128), (6, 256), (3, 512))
_EXPANSION = 4
_STEM = 64
_GEM_POWER = 3.0
_GEM_LEAST = 1e-6


class Resnet50(nn.Module):
    """ResNet-50 up to its last group: (N, 1, S, S) float32 in [0, 1] → (N, 2048, S / 32, S / 32).

    Names of layers, and strides on the 3 × 3 convolutions, are as in torchvision, so that its weights can be loaded.
    """

    def __init__(self, side_px: int) -> None:
        super().__init__()
        side = side_px // CARTESIAN_REDUCTION
        self.shape = (RESNET50_GROUPS[-1][1] * _EXPANSION, side, side)
        self.colour = GreyToColour()
        self.conv1 = nn.Conv2d(3, _STEM, 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(_STEM)
        self.relu = nn.ReLU(inplace=True)
        self.maxpool = nn.MaxPool2d(3, stride=2, padding=1)
        inputs, groups = _STEM, []
        for index, (blocks, inner) in enumerate(RESNET50_GROUPS):
            layers = []
            for block in range(blocks):
                layers.append(Bottleneck(inputs, inner, 2 if index and not block else 1))
                inputs = inner * _EXPANSION
            groups.append(nn.Sequential(*layers))
        self.layer1, self.layer2, self.layer3, self.layer4 = groups

    @property
    def groups(self) -> tuple[nn.Module, ...]:
        """The stem and the four groups of blocks, from the image on."""
        return nn.ModuleList([self.conv1, self.bn1]), self.layer1, self.layer2, self.layer3, self.layer4

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, 1, S, S) → (N, 2048, S / 32, S / 32)."""
        stem = self.maxpool(self.relu(self.bn1(self.conv1(self.colour(image)))))
        features: torch.Tensor = self.layer4(self.layer3(self.layer2(self.layer1(stem))))
        return features


class Bottleneck(nn.Module):
    """Three convolutions and a skip connection: (N, `inputs`, h, w) → (N, 4 · `inner`, h / s, w / s)."""

    def __init__(self, inputs: int, inner: int, stride: int) -> None:
        super().__init__()
        outputs = inner * _EXPANSION
        self.conv1 = nn.Conv2d(inputs, inner, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(inner)
        self.conv2 = nn.Conv2d(inner, inner, 3, stride=stride, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(inner)
        self.conv3 = nn.Conv2d(inner, outputs, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(outputs)
        self.relu = nn.ReLU(inplace=True)
        self.downsample: nn.Module | None = None
        if stride > 1 or inputs != outputs:
            self.downsample = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride=stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """(N, `inputs`, h, w) → (N, 4 · `inner`, h / s, w / s) with stride s."""
        inner = self.relu(self.bn2(self.conv2(self.relu(self.bn1(self.conv1(features))))))
        skip = features if self.downsample is None else self.downsample(features)
        found: torch.Tensor = self.relu(self.bn3(self.conv3(inner)) + skip)
        return found


class GeneralisedMean(nn.Module):
    """GeM (Radenović et al., 2018): (N, C, h, w) ≥ 0 → (N, C, 1, 1), the generalised mean with a learned power."""

    def __init__(self) -> None:
        super().__init__()
        self.power = nn.Parameter(torch.tensor([_GEM_POWER]))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """(N, C, h, w) → (N, C, 1, 1)."""
        raised = features.clamp_min(_GEM_LEAST).pow(self.power)
        pooled: torch.Tensor = raised.mean(dim=(2, 3), keepdim=True).pow(1.0 / self.power)
        return pooled
