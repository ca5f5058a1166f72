"""Convolutional backbones: image to feature map. Needs torch."""

from __future__ import annotations

import torch
from torch import nn

from offradar_ros.encoders.network_config import CARTESIAN_REDUCTION, POLAR, POLAR_REDUCTION, NetworkConfig
from offradar_ros.encoders.networks.grey_to_colour import GreyToColour
from offradar_ros.encoders.networks.resnet50 import Resnet50

# Channels of VGG-16's 13 convolutions, pooled after each group (Simonyan and Zisserman, 2015, configuration D).
VGG16_GROUPS = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))

# Output channels, size and stride of the compact backbone's convolutions; together they reduce eight times.
COMPACT_CONVOLUTIONS = ((48, 7, 4), (96, 3, 2), (128, 3, 1), (128, 3, 1))
COMPACT_FEATURES = 48
COMPACT_FREQUENCIES = 8
COMPACT_ROLLS = (0, 2, 4, 6)
_TINY = 1e-10
# Scales standardised power to the scale of power.
_CONTRAST = 0.25
_LEAST_DEVIATION = 0.01


class Vgg16(nn.Module):
    """VGG-16's convolutions: (N, 1, S, S) float32 in [0, 1] → (N, 512, S / 32, S / 32), after the fifth pooling.

    With `normalised` each convolution is followed by batch normalisation (see `without_batch_norm`). The layers of
    `features` are numbered as in torchvision's vgg16 and vgg16_bn, so that their weights can be loaded.
    """

    def __init__(self, side_px: int, normalised: bool = False) -> None:
        super().__init__()
        side = side_px // CARTESIAN_REDUCTION
        self.shape = (VGG16_GROUPS[-1][-1], side, side)
        layers: list[nn.Module] = []
        inputs = 3
        for group in VGG16_GROUPS:
            for outputs in group:
                layers.append(nn.Conv2d(inputs, outputs, 3, padding=1))
                layers += [nn.BatchNorm2d(outputs)] * normalised
                layers.append(nn.ReLU(inplace=True))
                inputs = outputs
            layers.append(nn.MaxPool2d(2))
        self.colour = GreyToColour()
        self.features = nn.Sequential(*layers)
        initialise_convolutions(self)

    @property
    def groups(self) -> tuple[nn.Module, ...]:
        """The convolutions before each pooling, from the image on."""
        pools = [number for number, layer in enumerate(self.features) if isinstance(layer, nn.MaxPool2d)]
        return tuple(self.features[start:end] for start, end in zip([0, *pools], pools, strict=False))

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, 1, S, S) → (N, 512, S / 32, S / 32)."""
        features: torch.Tensor = self.features(self.colour(image))
        return features


class Compact(nn.Module):
    """Convolutions of a polar image with circular padding, then the spectrum of their features over azimuth.

    (N, 1, A, R) float32 in [0, 1] → (N, 48, F, R / 8): the amplitudes of F = 8 frequencies over the A / 8 azimuths. A
    turn of the vehicle rolls the rows, which does not change amplitudes: a turn by 8 rows changes nothing, others only
    by aliasing of the strides. Outside training, the output is the mean over the image rolled by 0, 2, 4 and 6 rows, so
    that a turn by 2 rows changes nothing. Rows are padded circularly.

    The first of two channels is the image less its mean over azimuth at each range, the second is this at unit
    deviation. Neither depends on a receiver's gain, which adds a constant to the logarithm of power and differs between
    radars. Azimuths without any power were not measured: they take no part in mean and deviation, and are 0 in both
    channels. Without `centred`, as in the first edition, the first channel is the image, and all azimuths count.
    """

    around: torch.Tensor

    def __init__(self, image_shape: tuple[int, int], centred: bool = True) -> None:
        super().__init__()
        self.centred = centred
        azimuths, range_bins = (length // POLAR_REDUCTION for length in image_shape)
        self.shape = (COMPACT_FEATURES, min(COMPACT_FREQUENCIES, azimuths // 2 + 1), range_bins)
        before, after = _rows_around()
        self.register_buffer('around', torch.arange(-before, image_shape[0] + after) % image_shape[0], persistent=False)
        layers: list[nn.Module] = []
        inputs = 2  # the image, centred or not, and the image standardised
        for outputs, size, stride in COMPACT_CONVOLUTIONS:
            layers += [_NormalisedConvolution(inputs, outputs, size, stride), nn.ReLU(inplace=True)]
            inputs = outputs
        self.convolutions = nn.Sequential(*layers)
        self.reduce = _NormalisedConvolution(inputs, COMPACT_FEATURES, 1, 1)
        self.spectrum = AzimuthSpectrum(azimuths, self.shape[1])
        initialise_convolutions(self)

    @property
    def groups(self) -> tuple[nn.Module, ...]:
        """The normalised convolutions, from the image on."""
        return (*list(self.convolutions)[::2], self.reduce)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """(N, 1, A, R) → (N, 48, F, R / 8)."""
        offset, standardised = over_azimuth(image, measured(image) if self.centred else None)
        both = torch.cat([offset if self.centred else image, _CONTRAST * standardised], dim=1)
        if self.training:
            return self._amplitudes(both)
        # All rolls in one batch, so that each convolution is one node of an ONNX graph and is quantised once.
        rolls = [torch.cat([both[:, :, k:], both[:, :, :k]], dim=2) if k else both for k in COMPACT_ROLLS]
        rolled = torch.cat(rolls)
        return self._amplitudes(rolled).reshape(len(COMPACT_ROLLS), -1, *self.shape).mean(dim=0)

    def _amplitudes(self, image: torch.Tensor) -> torch.Tensor:
        spectrum: torch.Tensor = self.spectrum(self.reduce(self.convolutions(image.index_select(2, self.around))))
        return spectrum


def measured(image: torch.Tensor) -> torch.Tensor:
    """(N, 1, A, 1), 1 for each azimuth of (N, 1, A, R) power in [0, 1] that has a byte above 0, and else 0."""
    # The sum of bytes is 0 or at least 1; a factor of 2 leaves room for rounding.
    return (image.sum(dim=3, keepdim=True) * (2.0 * 255.0)).clamp(0.0, 1.0)


def over_azimuth(image: torch.Tensor, mask: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
    """(N, 1, A, R) less its mean over A, and this with deviation 1 over A; less than 1 where the contrast is low.

    Only azimuths that `mask`, (N, 1, A, 1) of 0 and 1, has as 1 are taken into account, and the others are 0.
    """
    if mask is None:
        offset = image - image.mean(dim=2, keepdim=True)
        variance = offset.square().mean(dim=2, keepdim=True)
    else:
        share = mask.mean(dim=2, keepdim=True) + _TINY
        offset = (image - (image * mask).mean(dim=2, keepdim=True) / share) * mask
        variance = offset.square().mean(dim=2, keepdim=True) / share
    return offset, offset / (variance.sqrt() + _LEAST_DEVIATION)


class AzimuthSpectrum(nn.Module):
    """Amplitudes of the first F frequencies over azimuth: (N, C, A, R) → (N, C, F, R).

    A product with F cosines and sines: for few frequencies faster than a fast Fourier transform, in every runtime.
    """

    cosines: torch.Tensor
    sines: torch.Tensor

    def __init__(self, azimuths: int, frequencies: int) -> None:
        super().__init__()
        phase = 2.0 * torch.pi * torch.outer(torch.arange(frequencies), torch.arange(azimuths)) / azimuths
        self.register_buffer('cosines', torch.cos(phase) / azimuths, persistent=False)
        self.register_buffer('sines', torch.sin(phase) / azimuths, persistent=False)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """(N, C, A, R) → (N, C, F, R), ≥ 0."""
        # Half precision would round small powers to 0, where the gradient of the root is infinite.
        with torch.autocast(features.device.type, enabled=False):
            features = features.float()
            power = (self.cosines @ features).square() + (self.sines @ features).square()
            return torch.sqrt(power + _TINY)


class _NormalisedConvolution(nn.Module):
    """Convolution and batch normalisation of a polar feature map; columns are padded with zeros, rows are not."""

    def __init__(self, inputs: int, outputs: int, size: int, stride: int) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(inputs, outputs, size, stride, padding=(0, size // 2), bias=False)
        self.normalise = nn.BatchNorm2d(outputs)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        normalised: torch.Tensor = self.normalise(self.convolution(features))
        return normalised


def _rows_around() -> tuple[int, int]:
    """Padding rows before and after an image that the first and last outputs of the convolutions need."""
    before = after = 0
    for _, size, stride in reversed(COMPACT_CONVOLUTIONS):
        before, after = stride * before + size // 2, stride * (after - 1) + 1 + size // 2
    return before, after


def initialise_convolutions(module: nn.Module) -> None:
    """He initialisation, which preserves the scale of the signal through ReLUs."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode='fan_out', nonlinearity='relu')
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)


def make_backbone(config: NetworkConfig) -> Vgg16 | Compact | Resnet50:
    """The backbone of a `NetworkConfig`; its `shape` is that of the feature map, (C, rows, columns)."""
    if config.backbone in POLAR:
        return Compact(config.image_shape, config.backbone == 'compact_centred')
    if config.backbone in ('vgg16', 'vgg16_bn'):
        return Vgg16(config.side_px, config.backbone == 'vgg16_bn')
    network = Resnet50(config.side_px)
    initialise_convolutions(network)
    return network
