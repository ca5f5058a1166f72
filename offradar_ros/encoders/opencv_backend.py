"""Runs an exported network with OpenCV's `dnn`, for machines with packages from apt only. CPU only.

Works with OpenCV 4.6 (Ubuntu 24.04) and later for what `export_onnx` writes of the compact backbone; other networks
need a later OpenCV or ONNX Runtime; a network that cannot run is refused when it is loaded.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.device import cuda_unavailable
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.onnx_file import in_single_precision
from offradar_ros.encoders.onnx_model import read_onnx
from offradar_ros.errors import ModelError


class OpencvEncoder(ImageEncoder):
    """Learned encoder in OpenCV; ModelError for a file that is missing, damaged or that this OpenCV cannot run."""

    def __init__(self, path: str | Path, threads: int = 0, device: str = 'auto') -> None:
        """`threads` sets OpenCV's threads for the whole process, 0 is every core; ConfigError for ``cuda``."""
        if device == 'cuda':
            raise cuda_unavailable('the opencv backend runs on the CPU only')
        model = read_onnx(path)
        if model.header.stored == 'int8':
            raise ModelError(
                f'{path}: OpenCV computes 8-bit integers differently from ONNX Runtime: pip install onnxruntime, or '
                f'use weights in single or half precision'
            )
        super().__init__(model.header, path, 'cpu')
        cv2.setNumThreads(threads or len(os.sched_getaffinity(0)))
        try:
            self._network = cv2.dnn.readNetFromONNX(np.frombuffer(in_single_precision(model.content), np.uint8))
            # Missing operators are reported by the first run.
            self.require_sound(model.probe)
        except (cv2.error, ValueError) as error:
            # The last line of the message names the operator.
            reason = str(error).strip().splitlines()[-1][:300]
            raise ModelError(
                f'{path}: OpenCV {cv2.__version__} cannot run it: pip install onnxruntime, or use a later OpenCV '
                f'({reason})'
            ) from error

    def infer(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Images (N, H, W) uint8 → mean and variance, both (N, d) float32, one image after the other."""
        answers = [self._run(images[index : index + 1]) for index in range(len(images))]
        means, variances = (np.concatenate(parts) for parts in zip(*answers, strict=True))
        return means, variances

    def _run(self, image: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and variance, both (1, d), of one image (1, H, W): OpenCV 4.6 accepts only one at a time."""
        # Without the wrapper, 4.6 treats the last axis as channels.
        wrapped: Any = cv2.Mat(image, wrap_channels=False)  # type: ignore[no-untyped-call]
        self._network.setInput(wrapped, 'images')
        mean, variance = self._network.forward(['mean', 'variance'])
        return np.asarray(mean, np.float32), np.asarray(variance, np.float32)
