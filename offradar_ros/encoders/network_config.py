"""Settings of the network of a learned encoder, stored with its weights. Needs no torch."""

from __future__ import annotations

import dataclasses
import reprlib
from typing import Any

from offradar_ros.bounded_input import parse_json
from offradar_ros.config import CartesianConfig, PolarGridConfig
from offradar_ros.encoders.fingerprint import canonical_json
from offradar_ros.encoders.registry import LEARNED
from offradar_ros.errors import ConfigError
from offradar_ros.records import structure, unstructure

# VGG-16 and ResNet-50 halve the image five times, the compact backbone three times.
CARTESIAN_REDUCTION = 32
POLAR_REDUCTION = 8

_LARGEST_SIDE = 4096

BACKBONES = ('vgg16', 'vgg16_bn', 'compact', 'compact_centred', 'resnet50')
CARTESIAN = ('vgg16', 'vgg16_bn', 'resnet50')
POLAR = ('compact', 'compact_centred')
DESCRIPTORS = ('z_i_plus_mu', 'z_i')
STUDENTS = ('bounded', 'free')


@dataclasses.dataclass(frozen=True)
class NetworkConfig:
    """Architecture of the network and its input image; ConfigError for invalid values.

    Attributes:
        method: ``variational`` (the paper's) or another learned method of `ENCODERS`.
        backbone: ``vgg16`` (the paper's), ``vgg16_bn`` (the same with batch normalisation, for training) or
            ``resnet50`` (STUN's) for a Cartesian image; ``compact_centred`` or ``compact``, its first edition, for a
            polar one.
        dimension: d, the length of Z_I, μ_V and σ².
        side_px: side of the square Cartesian image, a multiple of 32.
        azimuths: rows of the polar image, a multiple of 8.
        range_bins: columns of the polar image, a multiple of 8.
        resolution_m: metres for each pixel or column.
        min_range_m: nearer returns are blanked.
        descriptor: Z_I + μ_V (= E[Z]) or Z_I; used by the variational method only.
        dropout: probability that a feature is dropped; used by MC Dropout only.
        student: variance of STUN: ``bounded`` between 1 and e, as in its authors' code, or ``free``.
    """

    method: str = 'variational'
    backbone: str = 'vgg16'
    dimension: int = 128
    side_px: int = 256
    azimuths: int = 200
    range_bins: int = 128
    resolution_m: float = 0.5
    min_range_m: float = 2.5
    descriptor: str = 'z_i_plus_mu'
    dropout: float = 0.2
    student: str = 'bounded'

    def __post_init__(self) -> None:
        _expect(self.method in LEARNED, 'method', f'one of {", ".join(LEARNED)}', self.method)
        _expect(self.backbone in BACKBONES, 'backbone', f'one of {", ".join(BACKBONES)}', self.backbone)
        _expect(self.descriptor in DESCRIPTORS, 'descriptor', f'one of {", ".join(DESCRIPTORS)}', self.descriptor)
        _expect(1 <= self.dimension <= 65536, 'dimension', '1 to 65536', self.dimension)
        _expect(self.student in STUDENTS, 'student', f'one of {", ".join(STUDENTS)}', self.student)
        for name, reduction in (
            ('side_px', CARTESIAN_REDUCTION),
            ('azimuths', POLAR_REDUCTION),
            ('range_bins', POLAR_REDUCTION),
        ):
            pixels = getattr(self, name)
            whole = pixels % reduction == 0 and reduction <= pixels <= _LARGEST_SIDE
            _expect(whole, name, f'a multiple of {reduction} up to {_LARGEST_SIDE}', pixels)
        _expect(0.01 <= self.resolution_m <= 10.0, 'resolution_m', '0.01 to 10 m', self.resolution_m)
        _expect(0.0 <= self.min_range_m <= 50.0, 'min_range_m', '0 to 50 m', self.min_range_m)
        _expect(0.0 < self.dropout < 1.0, 'dropout', 'a probability between 0 and 1', self.dropout)

    @property
    def image(self) -> CartesianConfig | PolarGridConfig:
        """Configuration of the network's image."""
        if self.backbone in CARTESIAN:
            return CartesianConfig(self.side_px, self.resolution_m, self.min_range_m)
        return PolarGridConfig(self.azimuths, self.range_bins, self.resolution_m, self.min_range_m)

    @property
    def image_shape(self) -> tuple[int, int]:
        """(rows, columns) of that image."""
        return (self.side_px, self.side_px) if self.backbone in CARTESIAN else (self.azimuths, self.range_bins)

    @property
    def reach_m(self) -> float:
        """Range of the farthest point of that image, metres."""
        if self.backbone in CARTESIAN:
            return self.side_px * self.resolution_m / 2**0.5
        return self.range_bins * self.resolution_m

    def to_json(self) -> str:
        """Canonical JSON object of every setting."""
        return canonical_json(unstructure(self))

    @classmethod
    def from_json(cls, text: str) -> NetworkConfig:
        """The settings from the text of `to_json`; ConfigError for any other text."""
        try:
            tree = parse_json(text)
        except ValueError as error:
            raise ConfigError(f'network settings: expected JSON ({error})') from error
        if not isinstance(tree, dict):
            raise ConfigError(f'network settings: expected an object, got {text[:200]!r}')
        config = structure(cls, tree, 'network setting')
        missing = unstructure(config).keys() - tree.keys()
        if missing:
            raise ConfigError(f'network setting {min(missing)} is missing')
        return config


def _expect(condition: bool, name: str, expected: str, value: Any) -> None:
    if not condition:
        raise ConfigError(f'network setting {name}: expected {expected}, got {reprlib.repr(value)}')
