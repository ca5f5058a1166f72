"""The common part of learned encoders: a polar scan to the image of the network, and its output to an embedding."""

from __future__ import annotations

import abc
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.network_image import make_image
from offradar_ros.encoders.probe import Probe, probe_image, require_sound
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ModelError, RefusedInput
from offradar_ros.types import Embedding, PolarScan


class ImageEncoder(abc.ABC):
    """Encodes the image that the weights' header describes; a backend implements `infer`."""

    def __init__(self, header: WeightsHeader, path: str | Path, runs_on: str) -> None:
        """`runs_on`: ``cpu`` or ``cuda``, what the backend runs on."""
        self.header = header
        self._path = path
        self.runs_on = runs_on
        self._to_image = make_image(header.config)
        self._info = ModelInfo(
            name=header.config.method,
            fingerprint=header.fingerprint,
            dimension=header.config.dimension,
            metadata={
                'settings': header.config.to_json(),
                'created_by': header.created_by,
                'description': header.description,
                'stored': header.stored,
                # A name that is not UTF-8 is no text for a message or a map.
                'file': Path(path).name.encode(errors='replace').decode(),
            },
        )

    @property
    def info(self) -> ModelInfo:
        """The model's identity, from the weights: the same in every backend."""
        return self._info

    @abc.abstractmethod
    def infer(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Images (N, H, W) uint8 → mean and variance, both (N, d) float32, the outputs of the network."""

    def require_sound(self, expected: Probe | None = None) -> None:
        """Run the probe image; ModelError if its outputs are not those of a network in order, or not `expected`.

        A backend calls it when it can run, so that a runtime that computes something else is never used.
        """
        outputs = self.infer(probe_image(self.header.config))
        require_sound(outputs, self.header.config, self._path)
        if expected is not None and expected.differs(*outputs):
            raise ModelError(
                f'{self._path}: {type(self).__name__} computes another embedding of a probe image than the exporter '
                f'did: use another encoder.backend, or another version of that runtime'
            )

    def image(self, scan: PolarScan) -> NDArray[np.uint8]:
        """The network's image of a scan, (H, W) uint8; RefusedInput ``no_signal`` if it is empty or all zero."""
        image = self._to_image(scan) if scan.power.size else np.zeros((0, 0), np.uint8)
        if not image.any():
            raise RefusedInput(
                'no_signal',
                f'scan at {scan.stamp_ns} ns, shape {scan.power.shape}, holds no power within the image of the network',
            )
        return image

    def encode(self, scan: PolarScan) -> Embedding:
        """Embedding of one scan; RefusedInput ``no_signal`` if its image is empty or all zero.

        Values that are not finite are returned too: map and search refuse them.
        """
        mean, variance = self.infer(self.image(scan)[np.newaxis])
        return Embedding(scan.stamp_ns, mean[0], variance[0], self._info.fingerprint)
