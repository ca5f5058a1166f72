"""A fixed image and what a network gives for it, so that a runtime that computes something else is noticed at once."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.bounded_input import parse_json
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.errors import ConfigError, ModelError
from offradar_ros.records import structure, to_json

VALUES = 64
"""Most values of mean and of variance that are kept, evenly spaced."""
TOLERANCE = 0.05
"""Largest difference, of the largest value: that of 8-bit integers between processors is below it."""

_FIRST, _SECOND = 7, 13


def probe_image(config: NetworkConfig) -> NDArray[np.uint8]:
    """(1, H, W) uint8: a texture of every gray level."""
    height, width = config.image_shape
    rows, columns = np.ogrid[:height, :width]
    image: NDArray[np.uint8] = ((rows * _FIRST + columns * _SECOND + rows * columns) % 256).astype(np.uint8)
    return image[np.newaxis]


@dataclasses.dataclass(frozen=True)
class Probe:
    """Values of mean and variance of the probe image."""

    mean: tuple[float, ...]
    variance: tuple[float, ...]

    @classmethod
    def of(cls, mean: NDArray[np.float32], variance: NDArray[np.float32]) -> Probe:
        """From both outputs, (1, d), of a network."""
        return cls(_sample(mean), _sample(variance))

    def to_text(self) -> str:
        """Text for `from_text`."""
        return to_json(self)

    @classmethod
    def from_text(cls, text: str) -> Probe:
        """From the text of `to_text`; ConfigError for any other."""
        try:
            return structure(cls, parse_json(text), 'probe')
        except ValueError as error:
            raise ConfigError(f'probe: expected JSON ({error})') from error

    def differs(self, mean: NDArray[np.float32], variance: NDArray[np.float32]) -> bool:
        """Whether outputs (1, d) are not these within `TOLERANCE`."""
        return any(
            len(kept) != len(found) or np.abs(found - kept).max() > TOLERANCE * np.abs(kept).max()
            for kept, found in (
                (np.array(self.mean), np.array(_sample(mean))),
                (np.array(self.variance), np.array(_sample(variance))),
            )
        )


def require_sound(
    outputs: tuple[NDArray[np.float32], NDArray[np.float32]], config: NetworkConfig, path: str | Path
) -> None:
    """ModelError unless mean and variance of the probe image are (1, d), finite, and no variance is negative."""
    expected = (1, config.dimension)
    if any(output.shape != expected for output in outputs):
        shapes = ' and '.join(str(output.shape) for output in outputs)
        raise ModelError(f'{path}: expected outputs mean and variance of shape {expected}, got {shapes}')
    mean, variance = outputs
    if not np.isfinite(mean).all() or not np.isfinite(variance).all() or (variance < 0.0).any():
        raise ModelError(
            f'{path}: its outputs for a probe image are not finite, or of negative variance: export or train it again'
        )


def _sample(output: NDArray[np.float32]) -> tuple[float, ...]:
    at = np.unique(np.linspace(0, output.shape[1] - 1, min(VALUES, output.shape[1])).round().astype(int))
    return tuple(float(f'{value:.6g}') for value in output[0, at].tolist())
