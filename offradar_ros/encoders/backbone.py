"""Convolutional backbones: an image to a feature map of 1/32 of its side. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

# Channels of VGG-16's 13 convolutions, pooled after each group (Simonyan and Zisserman, 2015, configuration D).
VGG16_GROUPS = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))
COMPACT_CHANNELS = (32, 64, 96, 128, 128)

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


class Vgg16(nn.Module):
    """VGG-16's convolutions: (N, 1, S, S) float32 in [0, 1] → (N, 512, S / 32, S / 32), after the fifth pooling.

    The grey image is repeated to three channels, each normalised by ImageNet's mean and deviation, so that weights
    trained there fit. `features` numbers its layers as torchvision does.
    """

    channels = VGG16_GROUPS[-1][-1]
    pixel_mean: torch.Tensor
    pixel_std: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        inputs = 3
        for group in VGG16_GROUPS:
            for outputs in group:
                layers += [nn.Conv2d(inputs, outputs, 3, padding=1), nn.ReLU(inplace=True)]
                inputs = outputs
            layers.append(nn.MaxPool2d(2))
        self.features = nn.Sequential(*layers)
        self.register_buffer('pixel_mean', torch.tensor(IMAGENET_MEAN).view(1, 3, 1, 1), persistent=False)
        self.register_buffer('pixel_std', torch.tensor(IMAGENET_STD).view(1, 3, 1, 1), persistent=False)
        initialise_convolutions(self)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, 1, S, S) → (N, 512, S / 32, S / 32)."""
        normalised = (image.expand(-1, 3, -1, -1) - self.pixel_mean) / self.pixel_std
        features: torch.Tensor = self.features(normalised)
        return features


class Compact(nn.Module):
    """Five strided convolutions with batch normalisation, for small machines: → (N, 128, S / 32, S / 32).

    Sees the grey image in [0, 1] as it is.
    """

    channels = COMPACT_CHANNELS[-1]

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        inputs = 1
        for outputs in COMPACT_CHANNELS:
            layers += [
                nn.Conv2d(inputs, outputs, 3, stride=2, padding=1, bias=False),
                nn.BatchNorm2d(outputs),
                nn.ReLU(inplace=True),
            ]
            inputs = outputs
        self.features = nn.Sequential(*layers)
        initialise_convolutions(self)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, 1, S, S) → (N, 128, S / 32, S / 32)."""
        features: torch.Tensor = self.features(image)
        return features


def initialise_convolutions(module: nn.Module) -> None:
    """He's initialisation, which keeps the signal's scale through the ReLUs."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode='fan_out', nonlinearity='relu')
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)


def make_backbone(name: str) -> Vgg16 | Compact:
    """The backbone of a checked `NetworkConfig`."""
    return Vgg16() if name == 'vgg16' else Compact()
